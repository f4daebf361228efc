"""Whose turn it is: the bounds that the module states, under any weights."""

from math import floor

import pytest
from hypothesis import given
from hypothesis import strategies as st

from eigenfail_services.hub.scheduler import FairShare

WEIGHTS = st.lists(st.integers(1, 20), min_size=1, max_size=8)
TURNS_S = st.lists(st.floats(0.01, 10.0), min_size=8, max_size=8)
ROUNDING_S = 1e-6


def weighed(weights: list[int]) -> FairShare:
    shares = FairShare()
    for campaign, weight in enumerate(weights):
        shares.set_weight(campaign, weight)
    return shares


def turns(shares: FairShare, campaigns: range, turn_s: list[float], n: int) -> list[int]:
    """Whose they are, where all of them always have work."""
    taken = []
    for _ in range(n):
        chosen = shares.next_campaign(campaigns)
        assert chosen is not None
        shares.charge(chosen, turn_s[chosen])
        taken.append(chosen)
    return taken


@given(WEIGHTS, TURNS_S, st.integers(1, 400))
def test_what_each_is_given_stays_within_a_bound_of_its_share(weights, turn_s, n) -> None:
    campaigns = range(len(weights))
    taken = turns(weighed(weights), campaigns, turn_s, n)
    given_s = [taken.count(campaign) * turn_s[campaign] for campaign in campaigns]
    farthest_s = max(turn_s[campaign] / weights[campaign] for campaign in campaigns)
    for campaign, weight in enumerate(weights):
        due_s = weight / sum(weights) * sum(given_s)
        assert abs(given_s[campaign] - due_s) <= weight * farthest_s + ROUNDING_S


@given(WEIGHTS, st.integers(1, 10))
def test_with_equal_turns_nobody_waits_for_more_than_stated(weights, rounds) -> None:
    campaigns = range(len(weights))
    taken = turns(weighed(weights), campaigns, [1.0] * 8, rounds * sum(weights))
    for campaign, weight in enumerate(weights):
        others = [other for place, other in enumerate(weights) if place != campaign]
        most = sum(floor(other / weight) + 1 for other in others)
        places = [place for place, chosen in enumerate(taken) if chosen == campaign]
        assert places
        assert (
            max(b - a - 1 for a, b in zip([-1, *places], [*places, len(taken)], strict=True))
            <= most
        )


@given(WEIGHTS, TURNS_S, st.integers(1, 100), st.integers(1, 20))
def test_who_comes_anew_waits_for_at_most_one_turn_of_each(weights, turn_s, before, weight) -> None:
    shares, newcomer = weighed(weights), len(weights)
    turns(shares, range(newcomer), turn_s, before)
    shares.set_weight(newcomer, weight)
    taken = turns(shares, range(newcomer + 1), [*turn_s, 1.0], newcomer + 1)
    assert newcomer in taken


def test_time_without_work_is_not_saved_up() -> None:
    shares = weighed([1, 1])
    turns(shares, range(2), [1.0, 1.0], 2)
    for _ in range(1_000):  # the other one has nothing to do
        shares.next_campaign([0])
        shares.charge(0, 1.0)
    taken = turns(shares, range(2), [1.0, 1.0], 100)
    assert taken.count(1) == pytest.approx(50, abs=1)


def test_what_was_charged_too_much_is_made_good() -> None:
    shares = weighed([1, 1])
    turns(shares, range(2), [1.0, 1.0], 20)
    shares.charge(0, -5.0)
    assert turns(shares, range(2), [1.0, 1.0], 5) == [0] * 5


def test_a_new_weight_holds_from_then_on() -> None:
    shares = weighed([1, 1])
    turns(shares, range(2), [1.0, 1.0], 10)
    shares.set_weight(1, 9)
    taken = turns(shares, range(2), [1.0, 1.0], 100)
    assert taken.count(1) == pytest.approx(90, abs=2)


def test_what_is_over_is_begun_anew_under_the_same_number() -> None:
    shares = weighed([1, 9])
    turns(shares, range(2), [1.0, 1.0], 100)
    shares.remove(1)
    taken = turns(shares, range(2), [1.0, 1.0], 100)
    assert taken.count(1) == pytest.approx(50, abs=1)
