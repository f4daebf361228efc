"""Stop rules on a real service: one worker, two, or a pause in between stop at the same episode."""

import time

import deadlines
import pytest

from eigenfail.values.campaign import CampaignState

pytestmark = pytest.mark.service

FIELDS = {
    "name": "stopped",
    "method": "monte_carlo",
    "planner": "idm",
    "episodes": 400,
    "seed": 5,
    "settings": {"round_size": 10},
    "stop": {"failures": 10},
}


def finish(client, campaign):
    ended = client.campaigns.wait(campaign.id, timeout_s=deadlines.CAMPAIGN_S)
    counts = ended.counts
    assert (ended.state, counts.open) == (CampaignState.DONE, 0)
    assert counts.planned == counts.completed + counts.errored + counts.cancelled == 400
    return ended.stopped_because, counts.completed, client.campaigns.digest(campaign.id)


def test_a_rule_on_results_stops_at_the_same_episode_whoever_runs_it(client, start_worker) -> None:
    start_worker("one")
    alone = finish(client, client.campaigns.create(**FIELDS))
    because, completed, _ = alone
    assert "failures were found (rule: failures = 10)." in because
    assert "The round that was open was finished." in because
    assert completed < 400

    start_worker("two")
    assert finish(client, client.campaigns.create(**FIELDS)) == alone

    paused = client.campaigns.create(**FIELDS)
    while not client.campaigns.get(paused.id).counts.completed:
        time.sleep(0.02)
    client.campaigns.pause(paused.id)
    assert (
        client.campaigns.wait(paused.id, timeout_s=deadlines.CAMPAIGN_S).state
        is CampaignState.PAUSED
    )
    client.campaigns.resume(paused.id)
    assert finish(client, paused) == alone


def test_time_ends_a_campaign_and_says_so(client, start_worker) -> None:
    start_worker()
    fields = FIELDS | {"episodes": 100_000, "stop": {"wall_s": 1.0}}
    ended = client.campaigns.wait(
        client.campaigns.create(**fields).id, timeout_s=deadlines.CAMPAIGN_S
    )
    assert ended.state is CampaignState.DONE
    assert ended.stopped_because.startswith("It ran for 1.")
    assert ended.stopped_because.endswith(" s (rule: wall_s = 1.0).")
    assert ended.counts.cancelled > 0
    assert ended.active_s < 3.0
