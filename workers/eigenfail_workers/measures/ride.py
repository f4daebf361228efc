"""How roughly the truck was driven: jerk, hard braking, demands beyond what it can do."""

from eigenfail.values import Observation

HARD_BRAKING_MPS2 = 3.0
"""Braking beyond this is hard: about the 10 ft/s² that ITE's formula for yellow lights takes for a
comfortable deceleration, and above the 2.5 m/s² from which `rulebook` calls braking uncomfortable.
"""


class Ride:
    """Follows the accelerations that were applied.

    Jerk is |a_t - a_{t-1}| / dt of the applied acceleration. Before the first step it was 0:
    situations begin in steady driving. A truck at rest does not brake, whatever its pedals do.
    """

    def __init__(self) -> None:
        self._applied_mps2 = 0.0
        self._largest_change_mps2 = 0.0
        self._speed_mps = 0.0
        self._braking_hard = False
        self._told = False
        self._hard_brakings = 0
        self._clipped_steps = 0

    def sees(self, observation: Observation) -> None:
        """The start, or the truth after a step."""
        applied = observation.applied
        if applied is not None:
            self._told = True
            self._follow(applied.acceleration_mps2)
            self._clipped_steps += applied != observation.control
        self._speed_mps = observation.ego.speed_mps

    def _follow(self, told_mps2: float) -> None:
        applied_mps2 = told_mps2 if self._speed_mps > 0.0 else max(told_mps2, 0.0)
        change = abs(applied_mps2 - self._applied_mps2)
        self._largest_change_mps2 = max(self._largest_change_mps2, change)
        self._applied_mps2 = applied_mps2
        hard = applied_mps2 < -HARD_BRAKING_MPS2
        self._hard_brakings += hard and not self._braking_hard
        self._braking_hard = hard

    def max_jerk_mps3(self, dt_s: float) -> float | None:
        """The largest jerk; None if the simulator did not tell what it applied."""
        return self._largest_change_mps2 / dt_s if self._told else None

    @property
    def hard_brakings(self) -> int | None:
        """How often hard braking began; None if the simulator did not tell what it applied."""
        return self._hard_brakings if self._told else None

    @property
    def clipped_steps(self) -> int | None:
        """In how many steps something else was applied than was asked for; None as above."""
        return self._clipped_steps if self._told else None
