"""What the time of a campaign goes into: a clock that the test turns."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from eigenfail.values import Overhead
from eigenfail_services.hub.meter import Meter, Phase


class Clock:
    def __init__(self) -> None:
        self.now_s = 100.0

    def __call__(self) -> float:
        return self.now_s


@pytest.fixture
def clock() -> Clock:
    return Clock()


def test_time_goes_to_what_was_seen_at_its_beginning(clock: Clock) -> None:
    meter = Meter(clock)
    clock.now_s += 50.0  # before the first look nothing is known
    for phase, lasts_s in ((Phase.LEARNING, 3.0), (Phase.SIMULATING, 5.0), (Phase.WAITING, 7.0)):
        meter.look(phase)
        clock.now_s += lasts_s
    meter.look(None)
    clock.now_s += 11.0
    assert meter.take() == Overhead(3.0, 7.0, 0.0)
    assert meter.take() == Overhead()


def test_a_phase_goes_on_after_it_was_taken(clock: Clock) -> None:
    meter = Meter(clock)
    meter.look(Phase.LEARNING)
    clock.now_s += 2.0
    assert meter.take().learning_s == 2.0
    clock.now_s += 3.0
    assert meter.take().learning_s == 3.0


def test_what_could_not_be_kept_is_taken_again(clock: Clock) -> None:
    meter = Meter(clock)
    meter.look(Phase.WAITING)
    meter.discard(0.5)
    clock.now_s += 1.0
    taken = meter.take()
    meter.give_back(taken)
    clock.now_s += 1.0
    assert meter.take() == Overhead(0.0, 2.0, 0.5)


@given(st.lists(st.tuples(st.sampled_from([*Phase, None]), st.floats(0.0, 100.0), st.booleans())))
def test_no_time_is_made_or_lost(spells: list[tuple[Phase | None, float, bool]]) -> None:
    clock, taken = Clock(), []
    meter = Meter(clock)
    for phase, lasts_s, now in spells:
        meter.look(phase)
        clock.now_s += lasts_s
        if now:
            taken.append(meter.take())
    taken.append(meter.take())
    for phase in (Phase.LEARNING, Phase.WAITING):
        wanted = sum(lasts_s for at, lasts_s, _ in spells if at is phase)
        found = sum(getattr(each, f"{phase}_s") for each in taken)
        assert found == pytest.approx(wanted, abs=1e-6)
