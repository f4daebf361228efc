"""What a hub has to do, and who is there to do it: what whoever starts workers goes by."""

from collections.abc import Iterable, Sequence
from typing import Protocol

import msgspec

from eigenfail_services.hub.seats import Seat


class Work(msgspec.Struct, frozen=True):
    """What there is to do.

    Attributes:
        episodes: that are proposed and have no result: waiting, or with a worker.
        worker_s: how long one worker would take over them. [s]
    """

    episodes: int = 0
    worker_s: float = 0.0


class Muster(msgspec.Struct, frozen=True):
    """Work and workers at one moment.

    Attributes:
        present: names of the workers that are connected.
        idle: of those that hold nothing.
    """

    work: Work = Work()
    present: frozenset[str] = frozenset()
    idle: frozenset[str] = frozenset()


class Working(Protocol):
    """A campaign that runs."""

    def work(self) -> Work:
        """What there is to do for it."""


def muster(campaigns: Iterable[Working], seats: Sequence[Seat]) -> Muster:
    """Of these campaigns, and of these workers."""
    works = [campaign.work() for campaign in campaigns]
    held = {seat.name for seat in seats if seat.held}
    present = frozenset(seat.name for seat in seats)
    total = Work(sum(work.episodes for work in works), sum(work.worker_s for work in works))
    return Muster(total, present, present - held)
