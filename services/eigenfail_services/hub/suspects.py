"""Episodes that were running as their workers were lost: pure bookkeeping."""

from collections.abc import Iterator
from typing import NamedTuple

from eigenfail.values import EpisodeTask
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

    def __contains__(self, key: Key) -> bool:
        return key in self._found

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

    def miss(self, worker: str, missed: Missed) -> None:
        """Its worker's connection is closed."""
        self._missed[worker] = missed

    def is_back(self, worker: str) -> None:
        """It lives: it has died of nothing that it ran."""
        self._missed.pop(worker, None)

    def overdue(self, now_s: float) -> list[Missed]:
        """Those whose workers have not come back in time; they are not missed any more."""
        late = {worker: each for worker, each in self._missed.items() if now_s >= each.until_s}
        for worker in late:
            del self._missed[worker]
        return [*late.values()]
