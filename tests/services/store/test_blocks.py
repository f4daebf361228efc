"""Sums over blocks do not depend on arrival; analyses of an older release still read."""

from contextlib import closing

import msgspec
import numpy as np
import pytest
from sqlalchemy import update
from store_checks.examples import deliver, running

from eigenfail.testing.examples import analysis_result, collision
from eigenfail.values.analysis import AnalysisSettings, Diversity
from eigenfail.values.arrays import encode_array
from eigenfail.values.disturbance import NoiseTrajectory
from eigenfail_services.store.engine import Database, find_backend
from eigenfail_services.store.schema import analyses
from eigenfail_services.store.store import open_store

DIVERSITY = Diversity(
    failures=4,
    modes=2,
    largest_share=0.5,
    effective_modes=2.0,
    spread=None,
    coverage=(1,) * 5 + (2,) * 5,
    verdict="2 modes",
)


def test_sums_of_blocks_do_not_depend_on_the_order_of_arrival(url) -> None:
    sigmas = [1e-7, 1e6, 0.2, 1e9, 0.3, 5e-3, 7.0]
    noises = [np.full((3, 2), sigma, np.float32) for sigma in sigmas]
    crashes = [
        collision(index, noise=NoiseTrajectory(np.ones_like(sigma), sigma))
        for index, sigma in enumerate(noises)
    ]
    with closing(open_store(url)) as store:
        forwards, backwards = running(store), running(store)
        deliver(store, forwards, *crashes)
        for crash in reversed(crashes):
            deliver(store, backwards, crash)
        found = [store.figures.course(each.id, 5) for each in (forwards, backwards)]
    assert found[0] == found[1]
    logs = [crash.noise.log_probability for crash in crashes]
    assert [block.log_probability for block in found[0]] == [sum(logs[:5]), sum(logs[5:])]


def finished(store, result) -> int:
    analysis = store.analyses.create(running(store).id, AnalysisSettings())
    store.analyses.start(analysis.id)
    store.analyses.finish(analysis.id, result)
    return analysis.id


def test_how_diverse_failures_are_is_kept(store) -> None:
    analysis = finished(store, msgspec.structs.replace(analysis_result(), diversity=DIVERSITY))
    assert store.analyses.get(analysis).result.diversity == DIVERSITY


@pytest.mark.parametrize(
    ("noise_silhouette", "found"),
    [(0.5, "2 modes in 4 failures"), (0.7, "2 groups in 4 failures")],
)
def test_the_log_tells_of_modes_only_where_they_are_distinct(
    store, noise_silhouette, found
) -> None:
    result = msgspec.structs.replace(analysis_result(), noise_silhouette=noise_silhouette)
    analysis = store.analyses.get(finished(store, result))
    events = store.events.latest(1, analysis.campaign)
    assert events[-1].message.endswith(f"of campaign {analysis.campaign} is done: {found}.")


def test_a_result_of_an_older_release_reads_without_it(url) -> None:
    fields = msgspec.structs.asdict(analysis_result())
    del fields["diversity"]
    older = msgspec.msgpack.encode(fields, enc_hook=encode_array)
    with closing(open_store(url)) as store:
        analysis = finished(store, analysis_result())
        with closing(Database(find_backend(url))) as database, database.writing() as connection:
            connection.execute(update(analyses).values(result=older))
        found = store.analyses.get(analysis).result
    assert found.labels == (0, 1, 0, 1)
    assert found.diversity is None
