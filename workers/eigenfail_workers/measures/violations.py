"""When the time to collision and DRAC first went beyond their thresholds, vehicle by vehicle."""

from collections.abc import Iterable
from math import inf
from typing import NamedTuple

from eigenfail.values.assessment import NEAR_MISS_TTC_S, PEAK_BRAKING_MPS2
from eigenfail_workers.measures.conflict import Conflict


class FirstViolations(NamedTuple):
    """The first violations by one vehicle, as numbers of steps; None if there was none.

    Attributes:
        ttc_step: TTC < 1.5 s.
        drac_step: DRAC > 7.0 m/s².
        drac_at_warning_mps2: DRAC at `ttc_step`.
    """

    ttc_step: int | None = None
    drac_step: int | None = None
    drac_at_warning_mps2: float | None = None


NO_VIOLATIONS = FirstViolations()


class Violations:
    """Extremes of an episode, and the first violations by each vehicle."""

    def __init__(self) -> None:
        self._min_ttc_s = inf
        self._max_drac_mps2 = 0.0
        self._first: dict[int, FirstViolations] = {}

    def heed(self, step: int, vehicle: int, danger: Conflict) -> None:
        """A conflict with a vehicle after a step; steps come in order."""
        self._min_ttc_s = min(self._min_ttc_s, danger.ttc_s)
        self._max_drac_mps2 = max(self._max_drac_mps2, danger.drac_mps2)
        first = self._first.get(vehicle, NO_VIOLATIONS)
        if first.ttc_step is None and danger.ttc_s < NEAR_MISS_TTC_S:
            first = first._replace(ttc_step=step, drac_at_warning_mps2=danger.drac_mps2)
        if first.drac_step is None and danger.drac_mps2 > PEAK_BRAKING_MPS2:
            first = first._replace(drac_step=step)
        self._first[vehicle] = first

    @property
    def min_ttc_s(self) -> float | None:
        """The smallest time to collision with anybody; None without a conflict."""
        return self._min_ttc_s if self._min_ttc_s < inf else None

    @property
    def max_drac_mps2(self) -> float | None:
        """The largest DRAC towards anybody; None without a conflict."""
        return self._max_drac_mps2 if self._max_drac_mps2 > 0.0 else None

    def by(self, vehicle: int) -> FirstViolations:
        """The first violations by one vehicle."""
        return self._first.get(vehicle, NO_VIOLATIONS)

    def by_anybody(self) -> FirstViolations:
        """The earliest violations of all; DRAC at the warning is that of the earliest warning."""
        warned = [first for first in self._first.values() if first.ttc_step is not None]
        warning = min(warned, key=_ttc_step, default=NO_VIOLATIONS)
        drac_step = earliest(first.drac_step for first in self._first.values())
        return warning._replace(drac_step=drac_step)


def _ttc_step(first: FirstViolations) -> float:
    return inf if first.ttc_step is None else first.ttc_step


def earliest(steps: Iterable[int | None]) -> int | None:
    """The smallest number of those that are known."""
    return min((step for step in steps if step is not None), default=None)
