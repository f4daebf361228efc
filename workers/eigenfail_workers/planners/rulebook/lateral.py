"""Lateral profiles: from one lane to the next on the path of least jerk."""

from typing import Annotated

import msgspec
from msgspec import Meta

from eigenfail_workers.minimum_jerk import minimum_jerk


class LateralSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """How the truck changes lanes.

    Attributes:
        change_s: duration of a change at the speed at which it begins.
        shortest_m: the truck cannot turn on less than this, however slow it is.
    """

    change_s: Annotated[float, Meta(gt=0.0, le=20.0)] = 5.0
    shortest_m: Annotated[float, Meta(ge=35.0, le=200.0)] = 50.0


class LateralPath(msgspec.Struct, frozen=True, gc=False):
    """A path across the road; before and after it the lateral position stays what it is.

    Over the way, and not over time: a truck that brakes on it must not slide sideways.

    Attributes:
        from_m, to_m: lateral positions.
        begins_x_m: where along the road it begins; length_m: over which length it goes.
    """

    from_m: float
    to_m: float
    begins_x_m: float
    length_m: float

    def at(self, x_m: float) -> float:
        """The lateral position there [m]."""
        share = min(max((x_m - self.begins_x_m) / self.length_m, 0.0), 1.0)
        return self.from_m + (self.to_m - self.from_m) * minimum_jerk(share)[0]

    def left_m(self, x_m: float) -> float:
        """The way from there to its end; negative beyond it [m]."""
        return self.begins_x_m + self.length_m - x_m


def straight_on(y_m: float) -> LateralPath:
    """The path that stays where it is."""
    return LateralPath(y_m, y_m, 0.0, 1.0)


def change_way_m(speed_mps: float, settings: LateralSettings) -> float:
    """The way that a change takes if it begins at this speed [m]."""
    return max(speed_mps * settings.change_s, settings.shortest_m)
