"""First violations, worked out by hand, and what must hold for any course of an episode."""

from typing import NamedTuple

from hypothesis import given, settings
from hypothesis import strategies as st

from eigenfail_workers.measures.recorder import NO_VIOLATIONS, FirstViolations, ViolationTracker
from eigenfail_workers.values import TrafficConflict

many = settings(deadline=None, derandomize=True, max_examples=200)


class Heard(NamedTuple):
    """A conflict with a vehicle after a step."""

    step: int
    vehicle: int
    danger: TrafficConflict


def heeded(*course: Heard) -> ViolationTracker:
    found = ViolationTracker()
    for heard in course:
        found.add(*heard)
    return found


def dangers() -> st.SearchStrategy[TrafficConflict]:
    return st.builds(TrafficConflict, st.floats(0.01, 10.0), st.floats(0.01, 60.0))


courses = st.lists(st.tuples(st.integers(0, 2), dangers()), max_size=30).map(
    lambda course: [Heard(step, *heard) for step, heard in enumerate(course)]
)


def test_the_first_steps_beyond_the_thresholds() -> None:
    found = heeded(
        Heard(3, 0, TrafficConflict(1.5, 7.0)),
        Heard(4, 0, TrafficConflict(1.4, 4.5)),
        Heard(5, 0, TrafficConflict(0.9, 6.9)),
        Heard(6, 0, TrafficConflict(0.5, 7.1)),
        Heard(7, 0, TrafficConflict(0.2, 40.0)),
    )
    assert found.get_first_violations(0) == FirstViolations(4, 6, 4.5)
    assert found.find_earliest_violations() == found.get_first_violations(0)
    assert (found.min_ttc_s, found.max_drac_mps2) == (0.2, 40.0)


def test_fast_closing_violates_drac_before_ttc() -> None:
    # closing at 24 m/s: DRAC = 24 / (2 · TTC) is above 7 m/s² below 1.71 s
    course = (
        Heard(n, 0, TrafficConflict(ttc, 12.0 / ttc)) for n, ttc in enumerate((1.8, 1.7, 1.6, 1.5))
    )
    found = heeded(*course, Heard(4, 0, TrafficConflict(1.4, 12.0 / 1.4)))
    assert found.get_first_violations(0) == FirstViolations(4, 1, 12.0 / 1.4)


def test_each_vehicle_has_its_own_and_the_earliest_stand_for_all() -> None:
    found = heeded(
        Heard(2, 1, TrafficConflict(1.2, 0.5)),
        Heard(5, 0, TrafficConflict(0.8, 7.5)),
        Heard(9, 1, TrafficConflict(0.4, 12.0)),
    )
    assert found.get_first_violations(1) == FirstViolations(2, 9, 0.5)
    assert found.get_first_violations(0) == FirstViolations(5, 5, 7.5)
    assert found.find_earliest_violations() == FirstViolations(2, 5, 0.5)
    assert found.get_first_violations(2) == NO_VIOLATIONS


def test_nothing_is_not_zero() -> None:
    found = ViolationTracker()
    assert (found.min_ttc_s, found.max_drac_mps2) == (None, None)
    assert found.find_earliest_violations() == found.get_first_violations(0) == NO_VIOLATIONS


@many
@given(courses)
def test_there_is_a_first_violation_just_if_the_extreme_is_one(course: list[Heard]) -> None:
    found = heeded(*course)
    first = found.find_earliest_violations()
    assert (first.ttc_step is not None) == (found.min_ttc_s is not None and found.min_ttc_s < 1.5)
    drac = found.max_drac_mps2
    assert (first.drac_step is not None) == (drac is not None and drac > 7.0)
    assert (first.drac_at_warning_mps2 is None) == (first.ttc_step is None)


@many
@given(courses, st.integers(0, 30))
def test_what_comes_later_changes_no_first_violation(course: list[Heard], cut: int) -> None:
    early, whole = heeded(*course[:cut]), heeded(*course)
    for vehicle in range(3):
        before, after = early.get_first_violations(vehicle), whole.get_first_violations(vehicle)
        assert before.ttc_step in {None, after.ttc_step}
        assert before.drac_step in {None, after.drac_step}
        assert before.drac_at_warning_mps2 in {None, after.drac_at_warning_mps2}
    assert (whole.min_ttc_s or 99.0) <= (early.min_ttc_s or 99.0)
    assert (whole.max_drac_mps2 or 0.0) >= (early.max_drac_mps2 or 0.0)


@many
@given(courses, st.permutations(range(3)))
def test_it_does_not_matter_how_the_vehicles_are_counted(
    course: list[Heard], names: list[int]
) -> None:
    found = heeded(*course)
    renamed = heeded(*(heard._replace(vehicle=names[heard.vehicle]) for heard in course))
    assert renamed.find_earliest_violations() == found.find_earliest_violations()
    assert [renamed.get_first_violations(names[vehicle]) for vehicle in range(3)] == [
        found.get_first_violations(n) for n in range(3)
    ]
