"""A real campaign is told where its time and money went."""

import deadlines
import pytest

pytestmark = pytest.mark.service


def test_the_time_of_a_campaign_is_accounted_for(client, start_worker) -> None:
    start_worker()
    created = client.campaigns.create(
        name="time", method="cem", planner="idm", episodes=60, seed=3, settings={"batch": 20}
    )
    ended = client.campaigns.wait(created.id, timeout_s=deadlines.CAMPAIGN_S)
    found = client.campaigns.cost(created.id)
    time = found.time
    parts = (time.simulation_s, time.learning_s, time.waiting_s, time.lost_s)
    assert sum(parts) == pytest.approx(ended.active_s)
    assert time.lost_s == 0.0
    # The learner's start alone takes longer than that; one worker ran all episodes.
    assert time.learning_s > 0.02
    assert time.simulation_s > 0.5 * time.worker_s
    curve = found.curve
    assert (curve[0].failures, curve[-1].failures) == (0, ended.counts.failures)
    assert curve[-1].usd == pytest.approx(found.cost.total_usd)
    assert client.campaigns.safety(created.id).collisions.k == ended.counts.failures
