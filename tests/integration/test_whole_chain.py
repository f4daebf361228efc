"""From a campaign over REST to failures that are grouped, replayed and priced."""

import time

import deadlines
import numpy as np
import pytest

from eigenfail import plugins
from eigenfail.client import Client
from eigenfail.errors import Conflict, UnknownName
from eigenfail.values.analysis import AnalysisState
from eigenfail.values.campaign import CampaignState
from eigenfail.values.episode import EpisodeTask, Outcome, TrajectorySource

pytestmark = pytest.mark.service


@pytest.fixture(scope="module")
def campaign(service, lasting_worker):
    """A campaign that is done; no test changes it."""
    with Client(service.address.url) as client:
        created = client.campaigns.create(
            name="chain", method="monte_carlo", planner="idm", episodes=80, seed=3
        )
        return client.campaigns.wait(created.id, timeout_s=deadlines.CAMPAIGN_S)


def test_failures_are_found_grouped_replayed_and_priced(client, campaign) -> None:
    summary = client.campaigns.summary(campaign.id)
    assert summary.failure_rate.k == summary.counts.failures > 5
    assert summary.failure_rate.interval.low < summary.failure_rate.value
    assert summary.cost.per_failure_usd == pytest.approx(
        summary.cost.total_usd / summary.counts.failures
    )

    analysis = client.analyses.wait(client.analyses.create(campaign.id).id)
    assert analysis.state is AnalysisState.DONE, analysis.problem
    assert sum(mode.failures for mode in analysis.result.modes) == summary.counts.failures
    assert analysis.result.features == "behaviour"
    assert len(analysis.result.behaviour.modes) == len(analysis.result.modes)
    assert all(": The ego " in words for words in analysis.result.words)

    client.analyses.prove(analysis.id)
    proof = client.analyses.wait_for_proof(analysis.id, timeout_s=deadlines.CAMPAIGN_S)
    assert {each.state for each in proof.scenarios} == {CampaignState.DONE}
    assert [len(each.replays) for each in proof.scenarios] == [2 * len(analysis.result.modes)] * 3
    same = next(each for each in proof.scenarios if each.is_same)
    assert same.medoids.rate.value == 1.0


def test_a_stored_episode_replays_to_its_digest(client, campaign) -> None:
    engine = plugins.load(plugins.ENGINES, "default")(campaign.spec.setup())
    for row in list(client.episodes.list(campaign.id))[:10]:
        stored = client.episodes.get(campaign.id, row.index)
        task = EpisodeTask(row.index, row.seed, TrajectorySource(stored.noise.z))
        (again,) = engine.run([task])
        assert again.digest() == stored.digest() == row.digest


def test_stored_numbers_agree_with_a_short_computation(client, campaign) -> None:
    """From the stored noise and scene alone, with none of the product's functions."""
    rows = list(client.episodes.list(campaign.id, outcome=Outcome.COLLISION))
    assert rows
    for row in rows[:5]:
        stored = client.episodes.get(campaign.id, row.index)
        metres = np.float64(stored.noise.z) * stored.noise.sigma
        density = np.exp(-0.5 * (metres / stored.noise.sigma) ** 2) / (
            stored.noise.sigma * np.sqrt(2 * np.pi)
        )
        assert row.log_probability == pytest.approx(np.log(density).sum(), rel=1e-5)

        ego, actor = stored.scene.vehicles[-1, 0], stored.scene.vehicles[-1, 1]
        velocity = [v[3] * np.array([np.cos(v[2]), np.sin(v[2])]) for v in (ego, actor)]
        severity = np.sum((velocity[0] - velocity[1]) ** 2)
        assert row.severity == pytest.approx(severity, rel=1e-3, abs=1e-3)
        assert row.robustness_m == 0.0

        dx, dy = np.abs(stored.scene.vehicles[:-1, 1, :2] - stored.scene.vehicles[:-1, 0, :2]).T
        np.testing.assert_allclose(stored.noise.sigma[:, 0], 0.02 * dx + 1.0, rtol=1e-4)
        np.testing.assert_allclose(stored.noise.sigma[:, 1], 0.00625 * dy + 0.2, rtol=1e-4)


def test_what_cannot_be_is_refused(client, campaign) -> None:
    with pytest.raises(UnknownName, match="monte_carlo"):
        client.campaigns.create(name="x", method="monte_carol", episodes=5)
    with pytest.raises(Conflict):
        client.campaigns.resume(campaign.id)


@pytest.mark.fault("planner that raises, or returns nothing or NaN")
@pytest.mark.parametrize("planner", ["test_raises", "test_returns_none", "test_returns_nan"])
def test_a_bad_planner_ends_its_campaign_with_every_fault_kept(
    client, lasting_worker, planner
) -> None:
    created = client.campaigns.create(name="bad", method="monte_carlo", planner=planner, episodes=5)
    ended = client.campaigns.wait(created.id, timeout_s=deadlines.CAMPAIGN_S)
    assert (ended.state, ended.counts.errored) == (CampaignState.DONE, 5)
    rows = list(client.episodes.list(created.id, outcome=Outcome.ERRORED))
    assert all(row.problem.startswith("planner: ") for row in rows)
    assert client.campaigns.summary(created.id).failure_rate is None


def test_a_cancelled_campaign_keeps_what_is_finished(client, lasting_worker) -> None:
    created = client.campaigns.create(
        name="cancelled", method="monte_carlo", planner="idm", episodes=100_000
    )
    while client.campaigns.get(created.id).counts.completed < 10:
        time.sleep(0.02)
    client.campaigns.cancel(created.id)
    ended = client.campaigns.wait(created.id, timeout_s=deadlines.CAMPAIGN_S)
    assert ended.state is CampaignState.CANCELLED
    counts = ended.counts
    assert counts.planned == counts.completed + counts.errored + counts.cancelled
    assert len(list(client.episodes.list(created.id))) == counts.completed + counts.errored
