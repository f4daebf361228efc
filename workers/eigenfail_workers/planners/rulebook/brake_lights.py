"""Brake lights: who brakes may come to a stop, and its track must follow faster.

The tracker's filters take a vehicle's speed for nearly constant. Behind one that brakes hard, the
measurements would soon be outside the gate. Lights are on or off: they tell no deceleration.
"""

from typing import Annotated

import msgspec
from msgspec import Meta

from eigenfail.values import Perception
from eigenfail_workers.planners.rulebook.kalman import AxisFilter
from eigenfail_workers.planners.rulebook.tracker import Track, Tracker, TrackerSettings


class BrakeLightSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """When lights are seen, and what that does.

    Attributes:
        lit_from_mps2: deceleration from which a vehicle's brake lights are on.
        acceleration_mps2: standard deviation of its acceleration as long as they are.
    """

    lit_from_mps2: Annotated[float, Meta(gt=0.0, le=10.0)] = 1.0
    acceleration_mps2: Annotated[float, Meta(ge=0.0, le=10.0)] = 5.0


class WatchfulTracker(Tracker):
    """A tracker that heeds brake lights.

    Attributes:
        braking: the tracks of those whose lights are on.
    """

    def __init__(self, settings: TrackerSettings, lights: BrakeLightSettings, dt_s: float) -> None:
        super().__init__(settings, dt_s)
        self._lights = lights
        self._speeds_mps: dict[int, float] = {}
        self.braking: set[Track] = set()

    def update(self, perception: Perception) -> list[Track]:
        """Look for brake lights, then take the perception in; see `Tracker.update`."""
        self.braking = {
            self._tracks[slot]
            for slot, seen in enumerate(perception.others)
            if self._brakes(slot, seen.speed_mps) and slot in self._tracks
        }
        for track in self.braking:
            loosen(track.along, self._lights.acceleration_mps2, self._dt_s)
        return super().update(perception)

    def _brakes(self, slot: int, speed_mps: float) -> bool:
        before_mps = self._speeds_mps.get(slot, speed_mps)
        self._speeds_mps[slot] = speed_mps
        return before_mps - speed_mps >= self._lights.lit_from_mps2 * self._dt_s


def loosen(along: AxisFilter, acceleration_sd_mps2: float, dt_s: float) -> None:
    """Make a filter less sure of the speed, by a random acceleration over one step."""
    along.p11 += (acceleration_sd_mps2 * dt_s) ** 2
