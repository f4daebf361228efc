"""What the time of a campaign goes into: a clock that the test turns."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from eigenfail.values.campaign import Overhead
from eigenfail_services.hub.metrics import CampaignPhase, TimeAccounting


class Clock:
    def __init__(self) -> None:
        self.now_s = 100.0

    def __call__(self) -> float:
        return self.now_s


@pytest.fixture
def clock() -> Clock:
    return Clock()


def test_time_goes_to_what_was_seen_at_its_beginning(clock: Clock) -> None:
    meter = TimeAccounting(clock)
    clock.now_s += 50.0  # before the first look nothing is known
    for phase, lasts_s in (
        (CampaignPhase.LEARNING, 3.0),
        (CampaignPhase.SIMULATING, 5.0),
        (CampaignPhase.WAITING, 7.0),
    ):
        meter.set_phase(phase)
        clock.now_s += lasts_s
    meter.set_phase(None)
    clock.now_s += 11.0
    assert meter.take() == Overhead(3.0, 7.0, 0.0)
    assert meter.take() == Overhead()


def test_what_could_not_be_kept_is_taken_again(clock: Clock) -> None:
    meter = TimeAccounting(clock)
    meter.set_phase(CampaignPhase.WAITING)
    meter.add_discarded(0.5)
    clock.now_s += 1.0
    taken = meter.take()
    meter.give_back(taken)
    clock.now_s += 1.0
    assert meter.take() == Overhead(0.0, 2.0, 0.5)


@given(
    st.lists(
        st.tuples(st.sampled_from([*CampaignPhase, None]), st.floats(0.0, 100.0), st.booleans())
    )
)
def test_no_time_is_made_or_lost(spells: list[tuple[CampaignPhase | None, float, bool]]) -> None:
    clock, taken = Clock(), []
    meter = TimeAccounting(clock)
    for phase, lasts_s, now in spells:
        meter.set_phase(phase)
        clock.now_s += lasts_s
        if now:
            taken.append(meter.take())
    taken.append(meter.take())
    for phase in (CampaignPhase.LEARNING, CampaignPhase.WAITING):
        wanted = sum(lasts_s for at, lasts_s, _ in spells if at is phase)
        found = sum(getattr(each, f"{phase}_s") for each in taken)
        assert found == pytest.approx(wanted, abs=1e-6)
