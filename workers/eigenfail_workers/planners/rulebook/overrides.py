"""Safety overrides: above rules and program stands what must not wait for either."""

from enum import StrEnum
from typing import Annotated

import msgspec
from msgspec import Meta

from eigenfail_workers.planners.rulebook.surroundings import Neighbour, required_deceleration


class OverrideSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """When the emergency brake comes and goes.

    Attributes:
        margin_m: gap that the emergency brake still means to keep.
        brake_at_mps2: required deceleration that calls for it.
        release_at_mps2: required deceleration at which it is released.
        brake_at_s: time to collision that calls for it, whatever the deceleration.
    """

    margin_m: Annotated[float, Meta(ge=0.0, le=20.0)] = 3.0
    brake_at_mps2: Annotated[float, Meta(gt=0.0, le=10.0)] = 3.5
    release_at_mps2: Annotated[float, Meta(gt=0.0, le=10.0)] = 2.0
    brake_at_s: Annotated[float, Meta(ge=0.0, le=5.0)] = 0.8


class Override(StrEnum):
    """What overrode the plan."""

    NONE = "none"
    EMERGENCY_BRAKE = "emergency_brake"
    QP_FALLBACK = "qp_fallback"


class EmergencyBrake:
    """Full braking, from one threshold until another: no flicker."""

    def __init__(self, settings: OverrideSettings) -> None:
        self._settings = settings
        self._braking = False

    def update(self, lead: Neighbour | None, speed_mps: float) -> bool:
        """Whether to brake now."""
        if lead is None:
            self._braking = False
            return False
        closing_mps = speed_mps - lead.speed_mps
        need = required_deceleration(lead.gap_m, closing_mps, self._settings.margin_m)
        bar = self._settings.release_at_mps2 if self._braking else self._settings.brake_at_mps2
        self._braking = need > bar or lead.gap_m < closing_mps * self._settings.brake_at_s
        return self._braking


def fall_back(planned_mps2: float) -> float:
    """Without a refined plan: the candidate's own braking, and no acceleration [m/s²]."""
    return min(planned_mps2, 0.0)
