"""Proof by replay on the page of an analysis."""

import pytest

from eigenfail.presentation.analyses import format_reproduction
from eigenfail.values.episode import Outcome
from eigenfail.values.estimates import Rate
from eigenfail.values.proof import Reproduction
from eigenfail_services.statistics.intervals import rate


@pytest.fixture
def prove(http):
    """Asks for a proof; the campaigns that replay."""

    def ask(analysis, **wanted):
        asked = http.post(f"/api/v1/analyses/{analysis}/proof", json=wanted)
        assert asked.status_code == 202
        return [scenario["campaign"] for scenario in asked.json()["scenarios"]]

    return ask


@pytest.fixture
def replayed(deliver, result):
    """Delivers the four episodes of a replay."""

    def go(campaign, crashed):
        outcomes = [Outcome.COLLISION if index in crashed else Outcome.SAFE for index in range(4)]
        deliver(campaign, *(result(index, outcomes[index]) for index in range(4)))

    return go


def test_replays_are_counted_without_an_interval():
    found = Reproduction(rate(3, 4), 0.0)
    assert isinstance(found.rate, Rate)
    figure = format_reproduction(found)
    assert (figure.value, figure.notes) == ("3 of 4", ())
    for unit, words in (("m", "1.25 m"), ("", "1.25")):
        (nearest,) = format_reproduction(Reproduction(rate(0, 2), 1.25), unit).notes
        assert nearest == f"smallest robustness {words}"
    assert format_reproduction(Reproduction()).line == "– (no replay completed)"


def test_a_proof_is_followed_until_its_last_replay(store, finished, check_page, prove, replayed):
    address = f"/analyses/{finished(2)}"
    same, near = prove(1, variations=[{}, {"distance_m": 61.0}])
    check_page("dashboard/proof/begun", address, "proof")
    # Eigenfailures of both modes come first, then their medoids.
    replayed(same, crashed=(0, 2))
    check_page("dashboard/proof/half", address, "proof")
    replayed(near, crashed=())
    for campaign in (same, near):
        store.campaigns.move(campaign, "done")
    check_page("dashboard/proof/ended", address, "proof")


def test_a_replay_that_came_to_nothing_may_be_asked_for_again(check_page, store, finished, prove):
    analysis = finished(1)
    (only,) = prove(analysis, variations=[{}])
    store.campaigns.move(only, "cancelled")
    check_page("dashboard/proof/cancelled", f"/analyses/{analysis}", "proof")


def test_a_replay_that_could_not_be_run_was_not_tried(
    *, check_page, finished, prove, deliver, failed, result
):
    analysis = finished(2)
    (only,) = prove(analysis, variations=[{}])
    deliver(only, failed(0), failed(1), result(2, Outcome.COLLISION), result(3))
    check_page("dashboard/proof/partly_errored", f"/analyses/{analysis}", "proof")


def test_replays_that_all_errored_are_not_shown_as_done(
    *, check_page, store, finished, prove, deliver, failed
):
    analysis = finished(2)
    (only,) = prove(analysis, variations=[{}])
    deliver(only, *(failed(index) for index in range(4)))
    store.campaigns.move(only, "done")
    check_page("dashboard/proof/errored", f"/analyses/{analysis}", "proof")
