"""Conformance suite of `Planner`.

@pytest.mark.parametrize("check", PLANNER_CHECKS)
def test_my_planner(check):
    check(lambda: MyPlanner(MyPlanner.Settings()))
"""

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from math import cos, hypot, isfinite
from time import perf_counter

import msgspec

from eigenfail.contracts import Planner
from eigenfail.process_state import ProcessState
from eigenfail.testing import expect
from eigenfail.values.scene import Control, Mission, Perception, VehicleState
from eigenfail.values.signals import is_signal_value, read_signal_names

MakePlanner = Callable[[], Planner]

MISSION = Mission(
    dt_s=0.1,
    lanes=2,
    lane_width_m=3.5,
    speed_limit_mps=25.0,
    desired_speed_mps=24.0,
    goal_x_m=1000.0,
)
STEPS = 80
DECISION_S = MISSION.dt_s
"""Time limit of a decision on average: the duration of a step."""


def cut_in_drive(shake_m: float = 1.0) -> list[Perception]:
    """Return the perceptions of a truck at constant speed while a car cuts in.

    Args:
        shake_m: amplitude of the perceived position around the true position. [m]
    """
    return [_frame(step, shake_m) for step in range(STEPS)]


def _frame(step: int, shake_m: float) -> Perception:
    time_s = step * MISSION.dt_s
    ego = VehicleState(24.0 * time_s, 0.0, 0.0, 24.0, 16.0, 2.5)
    # No random numbers: a check that fails has to fail again on the author's machine.
    swing = shake_m * cos(7.0 * step)
    drift_mps = -0.7 if 1.0 <= time_s < 6.0 else 0.0
    y = 3.5 - 0.7 * min(max(time_s - 1.0, 0.0), 5.0)
    actor = VehicleState(
        90.0 + 13.0 * time_s + swing, y + 0.2 * swing, drift_mps / 13.0, 13.0, 5.0, 2.0
    )
    return Perception(time_s, ego, (actor,), (1,))


def drive(
    planner: Planner, perceptions: Sequence[Perception], mission: Mission | None = None
) -> list[Control]:
    """Return the planner's answers over one episode, by default in a new mission."""
    planner.reset(mission or msgspec.structs.replace(MISSION))
    return [planner.act(perception) for perception in perceptions]


def _is_finite(control: object) -> bool:
    """Return whether an answer is a Control of two finite numbers."""
    if not isinstance(control, Control):
        return False
    return isfinite(hypot(control.acceleration_mps2, control.steering_rad))


def _gives_finite_controls(make: MakePlanner, perceptions: Sequence[Perception]) -> bool:
    """Return whether all answers are finite, without an error, if every vehicle is detected."""
    with suppress(Exception):
        return all(map(_is_finite, drive(make(), perceptions)))
    return False


def _alike(one: Sequence[Control], other: Sequence[Control]) -> bool:
    """Return whether two drives are equal bit for bit; as text, so that NaN equals NaN."""
    return repr(one) == repr(other)


def leaves_its_process_alone(make: MakePlanner) -> None:
    """An episode leaves rounding, numpy's errors, directory and signal handlers unchanged."""
    before = ProcessState()
    with suppress(Exception):  # what it raises is another check's subject
        drive(make(), cut_in_drive())
    changes = before.changes()
    before.restore()
    expect(not changes, f"The planner changed process-wide state: {'; '.join(changes)}.")


def returns_finite_controls(make: MakePlanner) -> None:
    """Every answer is a Control of two finite numbers."""
    for control in drive(make(), cut_in_drive()):
        expect(isinstance(control, Control), f"The planner returned {control!r}, not a Control.")
        expect(_is_finite(control), f"The planner returned {control}.")


def copes_with_what_it_misses(make: MakePlanner) -> None:
    """Every answer is finite, even if a vehicle is not detected for some steps, or never."""
    perceptions = cut_in_drive()
    unseen = [msgspec.structs.replace(each, others=(), ids=()) for each in perceptions]
    gaps = [*perceptions[:30], *unseen[30:40], *perceptions[40:50], unseen[50], *perceptions[51:]]
    if not _gives_finite_controls(make, perceptions):
        return  # that is another check's subject
    for seen in (gaps, unseen):
        for control in drive(make(), seen):
            finite = _is_finite(control)
            expect(finite, f"Where a vehicle was missed the planner returned {control!r}.")


def is_deterministic(make: MakePlanner) -> None:
    """Two planners with equal perceptions give equal answers, bit for bit."""
    same = _alike(drive(make(), cut_in_drive()), drive(make(), cut_in_drive()))
    expect(same, "Two planners answered the same perceptions differently.")


def forgets_at_reset(make: MakePlanner) -> None:
    """After a reset, also in the middle of an episode, a planner behaves like a new one."""
    used = make()
    # Two drives that differ from the third, and one that ends early as after a collision.
    for perceptions in (cut_in_drive(4.0), cut_in_drive(2.0)[: STEPS // 2]):
        drive(used, perceptions)
    same = _alike(drive(used, cut_in_drive()), drive(make(), cut_in_drive()))
    expect(same, "After a reset the planner answers otherwise than a new one: it kept something.")


def leaves_its_input_alone(make: MakePlanner) -> None:
    """A planner does not change its mission and perceptions."""
    perceptions, mission = cut_in_drive(), msgspec.structs.replace(MISSION)
    before = msgspec.msgpack.encode(perceptions)
    drive(make(), perceptions, mission)
    unchanged = msgspec.msgpack.encode(perceptions) == before
    expect(unchanged, "The planner changed a perception that it was shown.")
    expect(mission == MISSION, "The planner changed the mission that it was given.")


def decides_in_time(make: MakePlanner) -> None:
    """A decision takes no longer than a step, 0.1 s, on average."""
    planner, perceptions = make(), cut_in_drive()
    began = perf_counter()
    drive(planner, perceptions)
    # On average: a collection of garbage or another process may make one decision late.
    took_s = (perf_counter() - began) / STEPS
    late = f"A decision took {took_s:.3g} s on average; the budget is {DECISION_S} s."
    expect(took_s <= DECISION_S, late)


def explains_without_a_trace(make: MakePlanner) -> None:
    """An explanation has plain words and numbers, and does not change how the planner drives.

    The same holds for the planner's path, if it reports one: pairs of finite numbers.
    """
    asked = make()
    # Of a planner without them: called, `dict` and `tuple` return nothing to check.
    explain, path = getattr(asked, "explain", dict), getattr(asked, "path", tuple)
    asked.reset(msgspec.structs.replace(MISSION))
    answers = []
    for perception in cut_in_drive():
        answers.append(asked.act(perception))
        for name, value in explain().items():
            plain = isinstance(name, str) and isinstance(value, (str, int, float))
            expect(plain, f"Its account holds {name!r}: {value!r}, not a name and a plain value.")
        for x_m, y_m in path():
            drawn = isfinite(x_m) and isfinite(y_m)
            expect(drawn, f"Its path holds {(x_m, y_m)}, not two finite numbers.")
    same = _alike(answers, drive(make(), cut_in_drive()))
    expect(
        same, "A planner that was asked to explain itself drives otherwise than one that was not."
    )


def reports_finite_signals(make: MakePlanner) -> None:
    """After a reset and each step, `signals` has a finite number for each of its `signal_names`."""
    planner = make()
    names, signals = read_signal_names(planner), getattr(planner, "signals", dict)
    if not names:
        return
    planner.reset(msgspec.structs.replace(MISSION))
    _require_finite(signals(), names)
    for perception in cut_in_drive():
        planner.act(perception)
        _require_finite(signals(), names)


def _require_finite(reported: Mapping[str, object], names: Sequence[str]) -> None:
    for name in names:
        value = reported.get(name)
        expect(is_signal_value(value), f"Its signal {name!r} is {value!r}, not a finite number.")


PLANNER_CHECKS: tuple[Callable[[MakePlanner], None], ...] = (
    leaves_its_process_alone,  # first: what it finds would change what the others compute
    returns_finite_controls,
    copes_with_what_it_misses,
    is_deterministic,
    forgets_at_reset,
    leaves_its_input_alone,
    decides_in_time,
    explains_without_a_trace,
    reports_finite_signals,
)
