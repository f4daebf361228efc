"""Values that the parts of an episode exchange."""

import msgspec

from eigenfail.values.scene import VehicleState

Point = tuple[float, float]
"""A position or a vector in the road's plane. [m]"""


class GroundTruth(msgspec.Struct, frozen=True, gc=False):
    """True states of all vehicles, and whether the ego touches another one.

    Attributes:
        ids: number of each other vehicle, from 1; None if all of them are there throughout.
    """

    ego: VehicleState
    others: tuple[VehicleState, ...]
    collided: bool
    ids: tuple[int, ...] | None = None


class Separation(msgspec.Struct, frozen=True, gc=False):
    """Distance and direction between two footprints.

    Attributes:
        distance_m: smallest distance between them; 0 if they touch or overlap.
        direction: unit vector along the line of nearest points, from the first footprint to the
            second; (0, 0) if they touch or overlap.
    """

    distance_m: float
    direction: Point


class TrafficConflict(msgspec.Struct, frozen=True, gc=False):
    """Two vehicles on the way to a collision.

    Attributes:
        ttc_s: time to collision: gap ÷ closing speed.
        drac_mps2: deceleration required to avoid the crash: closing speed² ÷ (2 · gap).
    """

    ttc_s: float
    drac_mps2: float


class Encounter(msgspec.Struct, frozen=True, gc=False):
    """The ego and one other vehicle after a step.

    Attributes:
        distance_m: smallest distance of their footprints since the last step.
        conflict: conflict between them; None if they do not close in on each other.
        within: conflicts within a long step, before that.
    """

    distance_m: float
    conflict: TrafficConflict | None
    within: tuple[TrafficConflict, ...] = ()

    @property
    def conflicts(self) -> tuple[TrafficConflict, ...]:
        """All conflicts since the last step, in their order."""
        return self.within + (() if self.conflict is None else (self.conflict,))
