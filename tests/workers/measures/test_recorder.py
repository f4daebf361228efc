"""What the record of an episode says, against its observations."""

from math import inf, nan

import numpy as np
import pytest
from msgspec.structs import replace

from eigenfail.errors import SimulatorError
from eigenfail.values.episode import Outcome
from eigenfail.values.measures import Measures
from eigenfail.values.records import Assessment, ConflictClass, assess
from eigenfail.values.scene import Control, Observation, VehicleState
from eigenfail_workers.measures.recorder import Recorder, compute_severity

DT_S = 0.1


def car(x: float, y: float, speed: float, heading: float = 0.0) -> VehicleState:
    return VehicleState(x, y, heading, speed, 4.0, 2.0)


def seen(step: int, ego_x: float, collided: bool = False) -> Observation:
    """An ego at 10 m/s and a standing car 20 m ahead of the start; another one 6 m aside."""
    others = (car(24.0, 0.0, 0.0), car(0.0, 8.0, 10.0))
    past = {"perceived": (25.0, 0.5), "control": Control(-1.0, 0.1)} if step else {}
    return Observation(step, car(ego_x, 0.0, 10.0), others, collided, collided, **past)


def recorded(*observations: Observation) -> Recorder:
    recorder = Recorder()
    for observation in observations:
        recorder.observe(observation, DT_S)
        recorder.add_disturbance((0.5, -0.25), (2.0, 0.25))
    return recorder


def test_the_start_counts_for_robustness() -> None:
    assert recorded(seen(0, 0.0)).measures(DT_S).robustness_m == 6.0


def test_measures_are_extremes_over_the_episode() -> None:
    measures = recorded(seen(0, 0.0), seen(1, 16.0), seen(2, 15.0)).measures(DT_S)
    assert measures.robustness_m == 4.0
    assert measures.min_ttc_s == pytest.approx(0.4)
    assert measures.max_drac_mps2 == pytest.approx(100.0 / 8.0)
    assert measures.severity is None


def test_a_collision_has_robustness_zero_and_reads_drac_before_it() -> None:
    recorder = recorded(seen(0, 0.0), seen(1, 19.0), seen(2, 20.5, collided=True))
    measures = recorder.measures(DT_S)
    assert recorder.collided
    assert measures.robustness_m == 0.0
    assert measures.max_drac_mps2 == pytest.approx(100.0 / 2.0)
    assert measures.severity == pytest.approx(100.0)


def test_without_closing_in_there_is_neither_ttc_nor_drac() -> None:
    alone = Observation(0, car(0.0, 0.0, 10.0), (car(30.0, 0.0, 10.0),))
    measures = recorded(alone).measures(DT_S)
    assert (measures.min_ttc_s, measures.max_drac_mps2) == (None, None)


def test_severity_is_of_the_touched_vehicle_and_of_the_vector_difference() -> None:
    touched = car(3.0, 1.0, 5.0, np.pi / 2)
    observation = Observation(3, car(0.0, 0.0, 10.0), (car(0.0, 9.0, 30.0), touched), True, True)
    assert compute_severity(observation) == pytest.approx(10.0**2 + 5.0**2)


def test_severity_of_two_touched_vehicles_is_of_the_deeper_one() -> None:
    others = (car(3.9, 0.0, 9.0), car(2.0, 0.0, 4.0))
    assert compute_severity(
        Observation(1, car(0.0, 0.0, 10.0), others, True, True)
    ) == pytest.approx(36.0)


def test_noise_is_float32_also_when_there_is_none() -> None:
    empty = Recorder().noise()
    assert empty.z.shape == empty.sigma.shape == (0, 2)
    noise = recorded(seen(0, 0.0)).noise()
    assert noise.z.dtype == noise.sigma.dtype == np.float32
    assert noise.injected.tolist() == [[1.0, -0.0625]]


def test_the_scene_has_one_row_more_than_steps() -> None:
    scene = recorded(seen(0, 0.0), seen(1, 1.0), seen(2, 2.0)).scene(0.1)
    assert scene.vehicles.shape == (3, 3, 4)
    assert scene.vehicles[:, 0, 0].tolist() == [0.0, 1.0, 2.0]
    assert scene.vehicles[0, 2].tolist() == [0.0, 8.0, 0.0, 10.0]
    assert scene.sizes.tolist() == [[4.0, 2.0]] * 3
    assert scene.perceived.tolist() == [[25.0, 0.5]] * 2
    assert scene.controls == pytest.approx(np.array([[-1.0, 0.1]] * 2), rel=1e-6)


@pytest.mark.parametrize("nowhere", [nan, inf, 1e39])
def test_a_vehicle_that_is_nowhere_is_refused(nowhere: float) -> None:
    with pytest.raises(SimulatorError, match="finite"):
        Recorder().observe(seen(0, nowhere), DT_S)


def course(*ways: tuple[float, float], collided: bool) -> Recorder:
    """An ego at 10 m/s, and two standing cars that far ahead of its front after each step.

    One is in its lane; the other begins 6 m aside, out of its path, and is put into it later.
    """
    recorder = Recorder()
    for step, (ahead, aside) in enumerate(ways):
        in_lane = car(4.0 + ahead, 0.0, 0.0)
        entering = car(4.0 + aside, 0.0 if aside < 99.0 else 8.0, 0.0)
        ended = collided and step == len(ways) - 1
        recorder.observe(
            Observation(step, car(0.0, 0.0, 10.0), (in_lane, entering), ended, ended), DT_S
        )
    return recorder


def test_times_of_violation_and_of_the_collision() -> None:
    # closing at 10 m/s: TTC < 1.5 s below 15 m, DRAC = 50 / gap > 7 m/s² below 7.14 m
    far = 99.0
    recorder = course((16.0, far), (14.9, far), (9.0, far), (7.0, far), (0.0, far), collided=True)
    measures = recorder.measures(DT_S)
    assert measures.ttc_violated_s == pytest.approx(0.1)
    assert measures.drac_at_warning_mps2 == pytest.approx(50.0 / 14.9)
    assert measures.drac_violated_s == pytest.approx(0.3)
    assert measures.collided_s == pytest.approx(0.4)
    assert assess(Outcome.COLLISION, measures) == Assessment(
        ConflictClass.PLANNER_FAILURE, pytest.approx(0.3), pytest.approx(0.1), unresolved=False
    )


def test_a_collision_is_judged_by_the_vehicle_that_was_struck() -> None:
    # The one in the lane is near from the start; the other appears 5 m ahead, and is struck.
    recorder = course((12.0, 99.0), (11.0, 99.0), (11.0, 5.0), (11.0, 0.0), collided=True)
    measures = recorder.measures(DT_S)
    assert measures.ttc_violated_s == pytest.approx(0.2)
    assert measures.drac_at_warning_mps2 == pytest.approx(10.0)
    assert assess(Outcome.COLLISION, measures).conflict is ConflictClass.UNAVOIDABLE
    assert measures.min_ttc_s == pytest.approx(0.5)


def test_a_collision_that_nothing_announced_is_unavoidable() -> None:
    measures = course((60.0, 99.0), (60.0, 0.0), collided=True).measures(DT_S)
    assert measures.min_ttc_s == pytest.approx(6.0)
    assert measures.ttc_violated_s is measures.drac_at_warning_mps2 is None
    assert assess(Outcome.COLLISION, measures) == Assessment(
        ConflictClass.UNAVOIDABLE, unresolved=False
    )


def test_without_a_collision_the_earliest_violation_of_any_counts() -> None:
    measures = course((60.0, 99.0), (60.0, 6.0), (14.0, 99.0), collided=False).measures(DT_S)
    assert measures.ttc_violated_s == measures.drac_violated_s == pytest.approx(0.1)
    assert measures.drac_at_warning_mps2 == pytest.approx(50.0 / 6.0)
    assert measures.collided_s is None
    assert assess(Outcome.SAFE, measures) == Assessment(ConflictClass.NEAR_MISS, unresolved=False)


def brake_with(peak_mps2: float, recorder: Recorder) -> Measures:
    """The measures if the ego's brakes can do so much."""
    start, *rest = recorder._course
    return recorded(replace(start, peak_braking_mps2=peak_mps2), *rest).measures(DT_S)


def test_the_class_is_that_of_the_vehicles_own_brakes() -> None:
    crashed = course((12.0, 99.0), (11.0, 99.0), (11.0, 5.0), (11.0, 0.0), collided=True)
    assert brake_with(10.0, crashed).drac_at_warning_mps2 == pytest.approx(10.0)
    for peak_mps2, conflict in (
        (9.9, ConflictClass.UNAVOIDABLE),
        (10.1, ConflictClass.PLANNER_FAILURE),
    ):
        measures = brake_with(peak_mps2, crashed)
        assert measures.peak_braking_mps2 == peak_mps2
        assert assess(Outcome.COLLISION, measures).conflict is conflict
        # Of the threshold of DRAC, which is the paper's, the brakes change nothing.
        assert measures.drac_violated_s == crashed.measures(DT_S).drac_violated_s
    ended = course((60.0, 99.0), (12.5, 99.0), collided=False)  # DRAC 50 / 12.5 = 4
    assert assess(Outcome.SAFE, brake_with(3.9, ended)).unresolved
    assert not assess(Outcome.SAFE, brake_with(4.1, ended)).unresolved


@pytest.mark.parametrize("peak_mps2", [0.0, -1.0, nan, inf])
def test_brakes_that_do_nothing_are_refused(peak_mps2: float) -> None:
    with pytest.raises(SimulatorError, match="`peak_braking_mps2` is"):
        recorded(replace(seen(0, 0.0), peak_braking_mps2=peak_mps2))


def test_the_first_moment_off_the_road_is_kept() -> None:
    recorder = Recorder()
    for step, off_road in enumerate((False, False, True, False, True)):
        recorder.observe(replace(seen(step, 0.0), off_road=off_road), DT_S)
    assert recorder.measures(DT_S).left_road_s == pytest.approx(0.2)
    assert recorded(seen(0, 0.0)).measures(DT_S).left_road_s is None


def test_the_ride_is_measured_with_the_rest() -> None:
    recorder = Recorder()
    recorder.observe(seen(0, 0.0), DT_S)
    for step in (1, 2):
        recorder.observe(replace(seen(step, 0.0), applied=Control(-4.0, 0.1)), DT_S)
    measures = recorder.measures(DT_S)
    assert measures.max_jerk_mps3 == pytest.approx(40.0)
    assert (measures.hard_brakings, measures.clipped_steps) == (1, 2)


def test_drac_at_the_last_step_is_the_largest_of_any_vehicle_then() -> None:
    # closing at 10 m/s on standing cars: DRAC = 50 / gap
    ended = course((2.0, 99.0), (9.0, 6.0), (5.0, 4.0), collided=False).measures(DT_S)
    assert ended.max_drac_mps2 == pytest.approx(50.0 / 2.0)
    assert ended.final_drac_mps2 == pytest.approx(50.0 / 4.0)
    assert assess(Outcome.SAFE, ended).unresolved


def test_a_conflict_that_was_over_at_the_last_step_is_resolved() -> None:
    alone = Observation(1, car(0.0, 0.0, 10.0), (car(30.0, 0.0, 10.0), car(0.0, 8.0, 10.0)))
    measures = recorded(seen(0, 16.0), alone).measures(DT_S)
    assert measures.max_drac_mps2 == pytest.approx(50.0 / 4.0)
    assert measures.final_drac_mps2 == 0.0
    assert assess(Outcome.SAFE, measures).unresolved is False


def test_after_a_collision_there_is_no_drac_left() -> None:
    measures = course((2.0, 99.0), (0.0, 99.0), collided=True).measures(DT_S)
    assert measures.final_drac_mps2 is None


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"perceived": (1e300, 0.0)}, r"step 1 `perceived` holds 1e\+300.*from -3.4"),
        ({"control": Control(0.0, -1e39)}, r"`control` holds -1e\+39"),
        ({"applied": Control(1e39, 0.0)}, r"`applied` holds 1e\+39"),
    ],
)
def test_numbers_that_would_become_infinite_are_refused(changes, words: str) -> None:
    with pytest.raises(SimulatorError, match=words):
        recorded(seen(0, 0.0), replace(seen(1, 1.0), **changes))


def test_what_was_not_perceived_is_kept() -> None:
    missed = replace(seen(1, 1.0), perceived=(nan, nan))
    assert np.isnan(recorded(seen(0, 0.0), missed).scene(0.1).perceived).all()


def show_frames(*at_m: float, step: int = 1) -> Observation:
    """A step whose frames are at these places of the ego; the last is the end of the step."""
    *frames, last = (seen(step, x_m) for x_m in at_m)
    return replace(last, frames=tuple(frames))


def test_frames_within_a_step_count_as_its_end_does() -> None:
    stepwise = recorded(seen(0, 0.0), seen(1, 5.0), seen(1, 16.0), seen(1, 15.0))
    at_once = recorded(seen(0, 0.0), show_frames(5.0, 16.0, 15.0))
    named = "robustness_m", "min_ttc_s", "max_drac_mps2"
    for name in named:
        assert getattr(at_once.measures(DT_S), name) == getattr(stepwise.measures(DT_S), name)
    assert at_once.scene(DT_S).vehicles.shape[0] == 2


def test_a_collision_in_a_frame_ends_the_episode_there() -> None:
    recorder = Recorder()
    recorder.observe(seen(0, 0.0), DT_S)
    met = recorder.observe(show_frames(10.0, 20.5, 0.0), DT_S)
    assert met.collided
    assert met.ended
    assert met.ego.x_m == pytest.approx(20.0, abs=0.6)
    assert met.control == Control(-1.0, 0.1)


def test_frames_show_that_a_straight_line_would_have_met_nobody() -> None:
    """Between both ends of the step a straight line leads through the car; the frames go round."""
    aside = replace(seen(1, 20.0), ego=car(20.0, -4.0, 10.0))
    past = replace(seen(1, 40.0), ego=car(40.0, 0.0, 10.0))
    start = replace(seen(0, 0.0))
    straight, round_it = Recorder(), Recorder()
    straight.observe(start, 4.0)
    assert straight.observe(past, 4.0).collided
    round_it.observe(start, 4.0)
    assert not round_it.observe(replace(past, frames=(aside,)), 4.0).collided
