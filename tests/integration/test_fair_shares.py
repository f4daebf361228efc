"""Campaigns side by side on a real service: shares of the workers' time, and the same episodes."""

import time

import deadlines
import pytest

from eigenfail.values.campaign import CampaignState
from eigenfail.values.campaign_spec import Priority

pytestmark = pytest.mark.service

FUNCTION = {
    "method": "monte_carlo",
    "settings": {"round_size": 500},
    "simulator": "function",
    "scenario": "function",
    "scenario_parameters": {"steps": 2},
    "seed": 5,
}
MANY = 100_000
WORKED_S = 15.0
HELD_S = 6.0
PATIENCE_S = deadlines.PROCESS_S
NEIGHBOURS = {
    "quick and urgent": ("brief", Priority.NORMAL),
    "slow and urgent": ("long", Priority.NORMAL),
    "quick": ("brief", Priority.LOW),
}


def create(client, name, function, priority, episodes=MANY):
    planner = f"eigenfail_sleeping:{function}"
    fields = {"name": name, "planner": planner, "priority": priority, "episodes": episodes}
    return client.campaigns.create(**FUNCTION, **fields).id


def worked_s(client, campaign) -> float:
    return sum(share.wall_s for share in client.campaigns.workers(campaign))


def shares(client, campaigns, worked_for_s=WORKED_S) -> list[float]:
    """Of the workers' time, from now on."""
    before = [worked_s(client, each) for each in campaigns]
    until_s = time.monotonic() + PATIENCE_S
    spent = [0.0] * len(before)
    while sum(spent) < worked_for_s:
        assert time.monotonic() < until_s, f"nothing moves: {spent}"
        time.sleep(0.2)
        after = (worked_s(client, each) for each in campaigns)
        spent = [now - then for now, then in zip(after, before, strict=True)]
    return [seconds / sum(spent) for seconds in spent]


def settle(client, campaigns) -> None:
    """Wait until all learners have started and what was leased before is done."""
    until_s = time.monotonic() + PATIENCE_S
    while not all(worked_s(client, each) for each in campaigns):
        assert time.monotonic() < until_s, "a campaign has no result"
        time.sleep(0.2)
    shares(client, campaigns, HELD_S)


def digest(client, campaign) -> str:
    ended = client.campaigns.wait(campaign, timeout_s=PATIENCE_S)
    assert ended.state is CampaignState.DONE, ended.stopped_because
    return client.campaigns.digest(campaign)


@pytest.fixture
def alone(client, start_worker) -> str:
    """The digest of ten episodes that nobody else was run beside; two workers stay."""
    for _ in range(2):
        start_worker()
    return digest(client, create(client, "ten", "brief", Priority.NORMAL, 10))


def test_three_campaigns_share_by_weight_and_a_fourth_is_soon_done(client, alone) -> None:
    running = {name: create(client, name, *asked) for name, asked in NEIGHBOURS.items()}
    settle(client, running.values())
    before = shares(client, running.values())
    weights = [priority.weight for _, priority in NEIGHBOURS.values()]
    assert before == pytest.approx([weight / sum(weights) for weight in weights], abs=0.12)
    client.campaigns.prioritise(running["quick"], Priority.HIGH)
    settle(client, running.values())
    assert shares(client, running.values())[-1] == pytest.approx(9 / 15, abs=0.15)

    beside = create(client, "ten", "brief", Priority.HIGH, 10)
    assert digest(client, beside) == alone
    ran = [row.finished_ms for row in client.episodes.list(beside)]
    meanwhile = sum(
        min(ran) <= row.finished_ms <= max(ran)
        for each in running.values()
        for row in client.episodes.list(each)
    )
    # Its own ten, what the others have a right to meanwhile, and what two workers hold before it.
    assert meanwhile < 200
    for each in running.values():
        client.campaigns.cancel(each)


def test_a_priority_changes_no_episode(client, alone) -> None:
    assert digest(client, create(client, "ten", "brief", Priority.LOW, 10)) == alone
