"""How urgent a campaign is beside others."""

from collections.abc import Mapping
from enum import StrEnum

import msgspec


class Priority(StrEnum):
    """A name for a weight: campaigns that run side by side share the workers' time by weight."""

    LOW = "low"
    NORMAL = "normal"
    HIGH = "high"

    @property
    def weight(self) -> int:
        """Its share of the workers' time is this ÷ the sum over all campaigns with work."""
        return WEIGHTS[self]

    @property
    def head_start_ms(self) -> int:
        """In the queue it stands where it would, had it been queued so much earlier."""
        return HEAD_STARTS_MS[self]


WEIGHTS: Mapping[Priority, int] = {Priority.LOW: 1, Priority.NORMAL: 3, Priority.HIGH: 9}

HOUR_MS = 3_600_000
HEAD_STARTS_MS: Mapping[Priority, int] = {
    Priority.LOW: 0,
    Priority.NORMAL: HOUR_MS,
    Priority.HIGH: 2 * HOUR_MS,
}
"""So nothing that is queued two hours later than a campaign is ever started before it."""


class PriorityChange(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What a campaign's priority is to be from now on."""

    priority: Priority
