"""Episodes that were running as their workers were lost: pure bookkeeping."""

from collections.abc import Iterator
from typing import NamedTuple

from eigenfail.values import EpisodeTask
from eigenfail.wire.claims import same_task
from eigenfail_services.hub.claims import Key


class Missed(NamedTuple):
    """What a worker ran as its connection was closed, and until when it may come back."""

    key: Key
    task: EpisodeTask
    until_s: float


class Suspects:
    """Those that wait to be counted, and those whose workers may have lost no more than a line."""

    def __init__(self) -> None:
        self._found: dict[Key, EpisodeTask] = {}
        self._missed: dict[str, Missed] = {}
        self._ran: dict[Key, dict[str, EpisodeTask]] = {}

    def __iter__(self) -> Iterator[tuple[int, EpisodeTask]]:
        """Campaigns and episodes that wait to be counted."""
        return ((campaign, task) for (campaign, _), task in self._found.items())

    def add(self, key: Key, task: EpisodeTask) -> None:
        """Its worker is gone for good."""
        self._found[key] = task

    def pop(self, key: Key) -> EpisodeTask | None:
        """It is counted, or has a result."""
        return self._found.pop(key, None)

    def withdraw(self, campaign: int) -> None:
        """Nobody needs to know any more."""
        self._found = {key: task for key, task in self._found.items() if key[0] != campaign}

    def withholds(self, key: Key, task: EpisodeTask) -> bool:
        """Whether nobody is to get it: it waits to be counted, or two are missed that ran it.

        One may have lost no more than its line. A second is not by chance, and a third would be
        lost before the first is counted.
        """
        same = [ran for ran in self._ran.get(key, {}).values() if same_task(ran, task)]
        return key in self._found or len(same) > 1

    def miss(self, worker: str, missed: Missed) -> None:
        """Its worker's connection is closed."""
        self.is_back(worker)
        self._missed[worker] = missed
        self._ran.setdefault(missed.key, {})[worker] = missed.task

    def is_back(self, worker: str) -> Missed | None:
        """It lives: it has died of nothing that it ran. None if it was not missed."""
        if missed := self._missed.pop(worker, None):
            del self._ran[missed.key][worker]
            if not self._ran[missed.key]:
                del self._ran[missed.key]
        return missed

    def excuse(self, away_s: float) -> None:
        """Nobody could come back for a while: that is not their staying away."""
        self._missed = {
            worker: each._replace(until_s=each.until_s + away_s)
            for worker, each in self._missed.items()
        }

    def overdue(self, now_s: float) -> list[Missed]:
        """Those whose workers have not come back in time; they are not missed any more.

        Of those that ran the same, one at a time: each of them is counted.
        """
        late = {
            each.key: worker
            for worker, each in self._missed.items()
            if now_s >= each.until_s and each.key not in self._found
        }
        return [missed for worker in late.values() if (missed := self.is_back(worker))]
