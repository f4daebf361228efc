"""Vehicles that come, react to the ego, and go: cars with a plan of motion, and a follower."""

from collections import deque
from collections.abc import Sequence
from math import atan2, hypot
from typing import NamedTuple

from eigenfail.errors import InvalidValue
from eigenfail.values.scene import VehicleState
from eigenfail_workers.motion import minimum_jerk
from eigenfail_workers.scenarios import CAR_LENGTH_M, CAR_WIDTH_M


class LateralShift(NamedTuple):
    """A move across the road, on the path of least jerk. Times are from the car's first moment."""

    begins_s: float
    lasts_s: float
    way_m: float


class SpeedChange(NamedTuple):
    """A constant acceleration, positive or negative, for a time, from the car's first moment on."""

    begins_s: float
    lasts_s: float
    acceleration_mps2: float


class PlannedCar:
    """A car with a plan of motion that does not depend on the ego.

    Args:
        x_m, y_m: position of its centre at first.
        speed_mps: its speed along the road at first.
        change: change of this speed; None for none.
        shifts: its moves across the road.
    """

    def __init__(
        self,
        x_m: float,
        y_m: float,
        speed_mps: float,
        change: SpeedChange | None = None,
        shifts: Sequence[LateralShift] = (),
    ) -> None:
        self._x_m = x_m
        self._y_m = y_m
        self._speed_mps = speed_mps
        self._change = change
        self._shifts = tuple(shifts)

    def find_state(self, time_s: float) -> VehicleState:
        """Return its state at a time after its first moment."""
        x_m = self._x_m + self._speed_mps * time_s
        along_mps = self._speed_mps
        change = self._change
        if change is not None:
            since_s = max(time_s - change.begins_s, 0.0)
            changing_s = min(since_s, change.lasts_s)
            gained_mps = change.acceleration_mps2 * changing_s
            along_mps += gained_mps
            # While the speed changes it gains half of the final gain on average; after that, all of
            # it.
            x_m += gained_mps * (since_s - 0.5 * changing_s)
        y_m, across_mps = self._y_m, 0.0
        for shift in self._shifts:
            share = min(max((time_s - shift.begins_s) / shift.lasts_s, 0.0), 1.0)
            done, rate = minimum_jerk(share)
            y_m += shift.way_m * done
            across_mps += shift.way_m * rate / shift.lasts_s
        speed_mps = hypot(along_mps, across_mps)
        heading_rad = atan2(across_mps, along_mps)
        return VehicleState(x_m, y_m, heading_rad, speed_mps, CAR_LENGTH_M, CAR_WIDTH_M)


class FollowerLaw(NamedTuple):
    """A linear law of car following, with a delay (Helly 1959, without its term for braking).

    The law chooses gain · (v_ego − v) + gap_gain · (gap − desired) from the state at t. This value
    acts in the step that begins at t + delay − dt and ends at t + delay: with a delay of one step,
    in the next step.

    Attributes:
        delay_steps: delay, in steps; at least 1.
        hardest_mps2, strongest_mps2: limits of a.
    """

    gain_per_s: float
    gap_gain_per_s2: float
    delay_steps: int
    hardest_mps2: float
    strongest_mps2: float


class FollowingCar:
    """A car that follows the ego in its lane by a law, in steps of `dt_s`.

    Args:
        start: its state at first.
        law: how it chooses its acceleration.
        dt_s: duration of a step.

    Raises:
        InvalidValue: the delay of the law is less than a step.
    """

    def __init__(self, start: VehicleState, law: FollowerLaw, dt_s: float) -> None:
        if law.delay_steps < 1:
            problem = f"The delay is {law.delay_steps} steps, and at least one is needed."
            raise InvalidValue("delay_steps", problem, "Give a delay of 1 step or more.")
        self.state = start
        self._law = law
        self._dt_s = dt_s
        self._chosen_mps2 = deque([0.0] * law.delay_steps)

    def follow(self, ego: VehicleState, desired_gap_m: float) -> None:
        """Drive for a step, and choose the acceleration of the step that the delay ends with.

        Args:
            ego: the ego at the end of the step.
            desired_gap_m: gap that it then desires, bumper to bumper.
        """
        state, law = self.state, self._law
        # The queue is as long as the delay: its first entry was chosen that many steps ago.
        self._chosen_mps2.append(0.0)
        speed_mps = max(state.speed_mps + self._chosen_mps2.popleft() * self._dt_s, 0.0)
        x_m = state.x_m + 0.5 * (state.speed_mps + speed_mps) * self._dt_s
        self.state = VehicleState(x_m, state.y_m, 0.0, speed_mps, state.length_m, state.width_m)
        gap_m = ego.x_m - x_m - 0.5 * (ego.length_m + state.length_m)
        wanted_mps2 = law.gain_per_s * (ego.speed_mps - speed_mps) + law.gap_gain_per_s2 * (
            gap_m - desired_gap_m
        )
        self._chosen_mps2[-1] = min(max(wanted_mps2, law.hardest_mps2), law.strongest_mps2)
