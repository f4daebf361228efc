"""One worker, two, or one killed in the middle: the same episodes, bit for bit."""

import time

import deadlines
import pytest

from eigenfail.values.campaign import CampaignState

pytestmark = pytest.mark.service

AST = {
    "method": "ast",
    "planner": "idm",
    "episodes": 60,
    "settings": {"round_size": 6, "warm_up": 12, "gradient_steps": 1},
}
MONTE_CARLO = {
    "method": "monte_carlo",
    "planner": "idm",
    "episodes": 90,
    "scenario_parameters": {"distance_m": {"uniform": [52, 70]}},
}
DIFS = {
    "method": "difs",
    "planner": "idm",
    "episodes": 60,
    "settings": {"initial_share": 0.2, "round_size": 12, "first_steps": 30, "steps": 10},
}


def create(client, **fields):
    return client.campaigns.create(name="same", seed=5, **fields)


def finish(client, campaign):
    ended = client.campaigns.wait(campaign.id, timeout_s=deadlines.CAMPAIGN_S)
    assert ended.state is CampaignState.DONE, ended.stopped_because
    counts = ended.counts
    assert (counts.completed, counts.open, counts.errored) == (counts.planned, 0, 0)
    return client.campaigns.digest(campaign.id)


def wait_for(client, campaign, completed: int) -> None:
    deadline = time.monotonic() + deadlines.PROCESS_S
    while client.campaigns.get(campaign.id).counts.completed < completed:
        assert time.monotonic() < deadline, "the campaign does not move"
        time.sleep(0.02)


@pytest.mark.fault("SIGKILL of a worker")
@pytest.mark.parametrize("fields", [MONTE_CARLO, AST, DIFS], ids=lambda fields: fields["method"])
def test_the_digest_depends_on_the_seed_alone(client, start_worker, fields) -> None:
    first = start_worker("one")
    alone = finish(client, create(client, **fields))

    second = start_worker("two")
    assert finish(client, create(client, **fields)) == alone

    disturbed = create(client, **fields)
    wait_for(client, disturbed, completed=10)
    first.kill()
    second.kill_child()
    assert finish(client, disturbed) == alone


def test_pause_and_resume_change_nothing(client, start_worker) -> None:
    start_worker()
    undisturbed = finish(client, create(client, **AST))
    campaign = create(client, **AST)
    wait_for(client, campaign, completed=12)
    client.campaigns.pause(campaign.id)
    paused = client.campaigns.wait(campaign.id, timeout_s=deadlines.CAMPAIGN_S)
    assert paused.state is CampaignState.PAUSED
    assert paused.counts.open > 0
    client.campaigns.resume(campaign.id)
    assert finish(client, campaign) == undisturbed
