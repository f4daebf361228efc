"""Importance functions: how close the ego is to a collision after a step.

Multilevel splitting continues the episodes with the largest values. An importance function changes
the variance of the estimate, but not its mean. It must rise early in episodes that will collide.
Required braking does so if a planner notices a vehicle too late: the gap is still wide, and closes
too fast. The distance does not: it falls in safe episodes as well.
"""

from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType
from typing import Final, NamedTuple

from eigenfail.values.episode import Importance
from eigenfail_workers.values import Encounter, TrafficConflict


class Approach(NamedTuple):
    """Encounters and acceleration of the ego after a step.

    Attributes:
        encounters: encounters of the ego with each other vehicle.
        acceleration_mps2: acceleration of the ego; 0 if the simulator does not report it.
    """

    encounters: Sequence[Encounter]
    acceleration_mps2: float

    def list_conflicts(self) -> list[TrafficConflict]:
        """Return the conflicts with all vehicles in the way."""
        return [one.conflict for one in self.encounters if one.conflict is not None]


AHEAD_S: Final = 1.0
# Keeps the value finite where the footprints would touch within that second.
SMALLEST_GAP_M: Final = 0.05


def predict_required_braking(approach: Approach) -> float:
    """Return DRAC if the ego keeps its acceleration for a second; 0 without a conflict. [m/s²]

    If the planner already brakes, the need shrinks. If it accelerates, the need grows. On `cut_in`,
    in 24 to 40 runs of each, splitting by this value took fewer episodes than splitting by DRAC
    itself, for the same precision.
    """
    return max(
        (_predict_drac(one, approach.acceleration_mps2) for one in approach.list_conflicts()),
        default=0.0,
    )


def _predict_drac(conflict: TrafficConflict, acceleration_mps2: float) -> float:
    # From TTC = gap ÷ closing and DRAC = closing² ÷ (2 · gap).
    closing_mps = 2.0 * conflict.drac_mps2 * conflict.ttc_s
    change_mps = acceleration_mps2 * AHEAD_S
    gap_m = closing_mps * conflict.ttc_s - (closing_mps + change_mps / 2.0) * AHEAD_S
    later_mps = max(closing_mps + change_mps, 0.0)
    return later_mps**2 / (2.0 * max(gap_m, SMALLEST_GAP_M))


def find_urgency(approach: Approach) -> float:
    """Return the inverse of the smallest time to collision; 0 without a conflict. [1/s]"""
    return max((1.0 / one.ttc_s for one in approach.list_conflicts()), default=0.0)


def find_nearness(approach: Approach) -> float:
    """Return the smallest distance of footprints with its sign changed. [m]"""
    return -min(one.distance_m for one in approach.encounters)


FUNCTIONS: Mapping[Importance, Callable[[Approach], float]] = MappingProxyType(
    {
        Importance.REQUIRED_BRAKING: predict_required_braking,
        Importance.TIME_TO_COLLISION: find_urgency,
        Importance.DISTANCE: find_nearness,
    }
)


def compute_importance(function: Importance, approach: Approach) -> float:
    """Return the importance of a step."""
    return FUNCTIONS[function](approach)
