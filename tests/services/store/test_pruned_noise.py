"""What is made of noise, where some of it was taken away: the same as before, or a refusal."""

import io
from contextlib import closing

import pyarrow.parquet as pq
import pytest
from pruned import COUNT, EVERYTHING, FIFTHS, LOST, change, ended, fill
from resolved import resolve_campaign
from store_checks.examples import WORKER, deliver, running

from eigenfail import plugins
from eigenfail.errors import InvalidValue, NoisePruned
from eigenfail.filters import BY_INDEX
from eigenfail.testing.examples import collision, result, spec
from eigenfail.values.analysis import AnalysisSettings
from eigenfail.values.episode import EpisodeTask, PriorSource, episode_seed
from eigenfail.values.operations import Retention
from eigenfail.values.records import Delivery
from eigenfail_services.campaigns.analysis_jobs import run_analysis
from eigenfail_services.campaigns.references import check_references, read_experience
from eigenfail_services.comparison.comparability import pair_episodes
from eigenfail_services.export_formats import ExportSource, Selection, write_parquet
from eigenfail_services.store.store import Store, open_store
from eigenfail_services.upkeep.pruning import PruneSelection, prune
from eigenfail_services.upkeep.verify import verify


def test_failures_are_analysed_as_before(sqlite_url) -> None:
    with closing(open_store(sqlite_url)) as store:
        campaign = running(store, episodes=60)
        deliver(store, campaign, *(collision(n, steps=20, source="prior") for n in range(30)))
        deliver(store, campaign, *(result(n) for n in range(30, 60)))
        ended(store, campaign)
        analyses = []
        for _ in range(2):
            analyses.append(store.analyses.create(campaign.id, AnalysisSettings(bootstrap=0)).id)
            run_analysis(store, analyses[-1])
            prune(sqlite_url, FIFTHS, EVERYTHING)
        first, second = (store.analyses.get(each).result for each in analyses)
        assert store.retention.of(campaign.id)
        assert first is not None
        assert second is not None
        assert (first.episodes, first.labels) == (second.episodes, second.labels)
        assert first.scores.tobytes() == second.scores.tobytes()


def test_an_export_with_noise_leaves_it_out_where_it_is_gone(sqlite_url) -> None:
    with closing(open_store(sqlite_url)) as store:
        fill(store)
        prune(sqlite_url, FIFTHS, EVERYTHING)
        source = ExportSource(store, 1, Selection((), BY_INDEX, ("index",)))
        file = b"".join(write_parquet(source, noise=True))
    found = pq.read_table(io.BytesIO(file)).to_pydict()
    noise = dict(zip(found["index"], found["longitudinal_z"], strict=True))
    there = [index for index, z in noise.items() if z is not None]
    assert there == sorted({*range(0, COUNT, 5), 11, 12, 13})


def test_pairs_are_compared_by_the_noise_that_is_there(sqlite_url) -> None:
    with closing(open_store(sqlite_url)) as store:
        one, other = (fill(store) for _ in range(2))
        assert (
            pair_episodes(store, [one], [other]).totals
            == pair_episodes(store, [other], [one]).totals
        )
        before = pair_episodes(store, [one], [other])
        prune(sqlite_url, FIFTHS, PruneSelection((one.id,)))
        prune(sqlite_url, Retention(keep_every=4), PruneSelection((other.id,)))
        assert pair_episodes(store, [one], [other]) == before


def test_a_campaign_cannot_learn_from_what_is_gone(sqlite_url) -> None:
    with closing(open_store(sqlite_url)) as store:
        fill(store)
        wanted = spec(method="difs", settings={"data_from": [1]})
        check_references(resolve_campaign(wanted), store)
        prune(sqlite_url, FIFTHS, EVERYTHING)
        refused = f"settings.data_from: the noise of {LOST} episodes of campaign 1"
        with pytest.raises(InvalidValue, match=refused):
            check_references(resolve_campaign(wanted), store)
        found = resolve_campaign(wanted)
        with pytest.raises(InvalidValue, match=refused):  # created although it was pruned meanwhile
            read_experience(found.references.data, found.form, store)


def really_run(store: Store) -> None:
    """Four episodes that can be run again."""
    campaign = running(store, planner="idm", episodes=4)
    engine = plugins.load(plugins.ENGINES, "default")(campaign.spec.setup())
    seed = campaign.spec.seed
    tasks = [EpisodeTask(n, episode_seed(seed, n), PriorSource()) for n in range(4)]
    store.episodes.commit(campaign.id, [Delivery(each, WORKER) for each in engine.run(tasks)])
    engine.close()
    ended(store, campaign)


def test_pruned_noise_that_its_method_chose_cannot_be_drawn_again_and_is_no_defect(
    sqlite_url,
) -> None:
    with closing(open_store(sqlite_url)) as store:
        really_run(store)
    change(sqlite_url, "UPDATE episodes SET source = 'policy', digest = 'x' WHERE \"index\" = 1")
    prune(sqlite_url, Retention(2, "policy"), EVERYTHING)
    assert verify(sqlite_url, 4).defects == 0


def test_a_pruned_episode_is_drawn_again_from_its_seed(sqlite_url) -> None:
    with closing(open_store(sqlite_url)) as store:
        really_run(store)
        prune(sqlite_url, Retention(keep_every=4), EVERYTHING)
        with pytest.raises(NoisePruned):
            store.episodes.get(1, 1)
    assert verify(sqlite_url, 4).defects == 0
    change(sqlite_url, "UPDATE episodes SET digest = 'x' WHERE \"index\" = 1")
    wrong = [check for check in verify(sqlite_url, 4).checks if check.defects]
    assert [check.name for check in wrong] == ["replays"]
    assert [defect.where for defect in wrong[0].shown] == ["episode 1/1"]
