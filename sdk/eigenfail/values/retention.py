"""Which episodes keep their noise, and which lost it to make room."""

from typing import Annotated, Final, Literal

import msgspec

from eigenfail.values.episode import Outcome

KEEP_EVERY = 100
DRAWN_AGAIN: Final = "prior"
"""The source whose noise follows from an episode's seed, so that nothing is lost with it."""


class Retention(msgspec.Struct, frozen=True):
    """What stays of a campaign: its rows, all failures, and of the others every so-manyth.

    Attributes:
        keep_every: of the indices; an episode whose index is a multiple keeps noise and scene.
        source: of the noise: prior, trajectory or policy; that of other episodes stays.
    """

    keep_every: Annotated[int, msgspec.Meta(ge=2)] = KEEP_EVERY
    source: Literal["prior", "trajectory", "policy"] = DRAWN_AGAIN

    def takes(self, outcome: Outcome, source: str, index: int) -> bool:
        """Whether an episode's noise goes: only what ran, and ended in no collision."""
        ours = outcome is Outcome.SAFE and source == self.source
        return ours and index % self.keep_every != 0


class Weight(msgspec.Struct, frozen=True):
    """How many episodes have noise that may go, and scenes with it, and how large they are."""

    episodes: int = 0
    scenes: int = 0
    bytes: int = 0

    def __add__(self, other: "Weight") -> "Weight":
        """Both together."""
        return Weight(
            self.episodes + other.episodes, self.scenes + other.scenes, self.bytes + other.bytes
        )


class Pruning(msgspec.Struct, frozen=True, kw_only=True):
    """What was taken from a campaign, by one command.

    Attributes:
        id: of the record.
        retention: by which rule.
        through: the index up to which it has come; it goes in index order.
        pruned_ms: when it began, in milliseconds since 1970.
        who: who gave the command.
        weight: what is gone.
    """

    id: int
    campaign: int
    retention: Retention
    through: int
    pruned_ms: int
    who: str
    weight: Weight

    def took(self, outcome: Outcome, source: str, index: int) -> bool:
        """Whether an episode has lost its noise to it, if it was still there."""
        return index <= self.through and self.retention.takes(outcome, source, index)


class PrunedCampaign(msgspec.Struct, frozen=True):
    """What went, or would go, of one campaign."""

    campaign: int
    name: str
    weight: Weight


class PruneReport(msgspec.Struct, frozen=True):
    """What a command took away, or would take away.

    Attributes:
        database: its address, without secrets.
        retention: by which rule.
        is_rehearsal: nothing was changed.
        in_use: campaigns that were passed over, or left before their end: one that has not ended
            needs their noise.
    """

    database: str
    retention: Retention
    is_rehearsal: bool
    campaigns: tuple[PrunedCampaign, ...]
    in_use: tuple[int, ...] = ()

    @property
    def weight(self) -> Weight:
        """Of all campaigns together."""
        return sum((each.weight for each in self.campaigns), Weight())


class Vacuumed(msgspec.Struct, frozen=True):
    """A database whose free room was given back.

    Attributes:
        database: its address, without secrets.
        bytes_before: its size on the disk.
        bytes_after: the same afterwards.
    """

    database: str
    bytes_before: int
    bytes_after: int
