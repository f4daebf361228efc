"""Which worker should get more work next: the one that has least, however many there are."""

from heapq import heapify, heappop, heappush
from itertools import count

SPARE = 64
"""So many outdated entries are not worth a clean-up."""

Entry = tuple[float, int, bytes]
"""How much work somebody has, when that was noted, and who it is."""


class Hungry:
    """A heap. What is no longer so stays in it until it comes up, or is more than half of it.

    A change costs O(log n) on average, and the next one's name nothing more.
    """

    def __init__(self) -> None:
        self._entries: dict[bytes, Entry] = {}
        self._heap: list[Entry] = []
        self._numbers = count()

    def put(self, worker: bytes, load_s: float) -> None:
        """It should get more, and has so much now."""
        entry = self._entries[worker] = (load_s, next(self._numbers), worker)
        heappush(self._heap, entry)
        if len(self._heap) > 2 * len(self._entries) + SPARE:
            self._heap = [*self._entries.values()]
            heapify(self._heap)

    def drop(self, worker: bytes) -> None:
        """It has enough, or is gone."""
        self._entries.pop(worker, None)

    def first(self) -> Entry | None:
        """Who has least; of equals, who has had so little for longest. None if all have enough."""
        while self._heap and self._entries.get(self._heap[0][2]) is not self._heap[0]:
            heappop(self._heap)
        return self._heap[0] if self._heap else None
