"""The table of states: complete, and every move leads where it says."""

import pytest

from eigenfail.errors import IllegalTransition
from eigenfail.values.campaign import FINAL_STATES, Campaign, CampaignState, Counts
from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail_services.store.lifecycle import (
    MOVES,
    PHRASES,
    REASONS,
    REPEATABLE,
    _check_move,
    move_campaign,
)

AT_MS = 1_700_000_000_000


@pytest.fixture
def campaign():
    """Makes a campaign in a state, with three of ten episodes behind it."""

    def make(state: CampaignState, **changes) -> Campaign:
        spec = CampaignSpec(name="example", method="monte_carlo", episodes=10)
        counts = Counts(10, completed=2, failures=1, errored=1)
        return Campaign(id=7, spec=spec, state=state, counts=counts, created_ms=1, **changes)

    return make


def test_every_state_has_its_moves_and_its_story() -> None:
    assert set(MOVES) == set(PHRASES) == set(CampaignState)
    assert set(REASONS) == FINAL_STATES


def test_final_states_are_those_without_a_way_out() -> None:
    assert {state for state, moves in MOVES.items() if not moves} == FINAL_STATES


def test_every_campaign_can_reach_an_end_on_a_users_word() -> None:
    for state in set(CampaignState) - FINAL_STATES:
        reached = {state}
        for _ in CampaignState:
            reached |= {target for source in reached for target in MOVES[source]}
        assert CampaignState.CANCELLED in reached


def test_every_state_can_be_reached_from_the_queue() -> None:
    reached = {CampaignState.QUEUED}
    for _ in CampaignState:
        reached |= {target for source in reached for target in MOVES[source]}
    assert reached == set(CampaignState)


def test_an_illegal_move_tells_its_story_and_the_ways_out() -> None:
    with pytest.raises(IllegalTransition) as caught:
        _check_move(CampaignState.PAUSED, CampaignState.DONE, "Campaign 7")
    assert str(caught.value) == (
        "Campaign 7 is paused: it cannot go from paused to done. "
        "From paused it can become: cancelled, queued."
    )


def test_an_end_is_the_end() -> None:
    with pytest.raises(IllegalTransition, match=r"was cancelled.*Launch a copy of the campaign"):
        _check_move(CampaignState.CANCELLED, CampaignState.QUEUED)


def test_only_wishes_of_users_may_be_repeated(campaign) -> None:
    for state in CampaignState:
        same = campaign(state)
        if state in REPEATABLE:
            assert move_campaign(same, state, "again", AT_MS) is same
        else:
            with pytest.raises(IllegalTransition):
                move_campaign(same, state, "again", AT_MS)
    assert {CampaignState.RUNNING, CampaignState.DONE, CampaignState.DEAD} == (
        set(CampaignState) - REPEATABLE
    )


@pytest.mark.parametrize("end", sorted(FINAL_STATES))
def test_at_the_end_nothing_is_open(campaign, end) -> None:
    ended = move_campaign(campaign(CampaignState.CANCELLING, started_ms=5), end, "", AT_MS)
    assert ended.counts == Counts(10, completed=2, failures=1, errored=1, cancelled=7)
    assert ended.counts.open == 0
    assert (ended.started_ms, ended.ended_ms) == (5, AT_MS)
    assert ended.stopped_because == REASONS[end]
    given = move_campaign(campaign(CampaignState.CANCELLING), end, "The disk is full.", AT_MS)
    assert given.stopped_because == "The disk is full."


def test_the_first_start_is_the_start(campaign) -> None:
    first = move_campaign(campaign(CampaignState.QUEUED), CampaignState.RUNNING, "", AT_MS)
    assert (first.started_ms, first.ended_ms, first.stopped_because) == (AT_MS, None, "")
    again = move_campaign(
        campaign(CampaignState.QUEUED, started_ms=5), CampaignState.RUNNING, "why", AT_MS
    )
    assert (again.started_ms, again.stopped_because) == (5, "")
    assert again.counts == Counts(10, completed=2, failures=1, errored=1)
