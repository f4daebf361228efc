"""What was worked out of a campaign's results holds for as long as no result comes in."""

from collections import OrderedDict
from collections.abc import Callable, Hashable
from threading import Lock
from typing import Any, TypeVar

Answer = TypeVar("Answer")

MOST = 512


class Entry:
    """An answer, and of how many results it is; a lock for who works it out."""

    def __init__(self) -> None:
        self.lock = Lock()
        self.results = -1
        self.answer: Any = None


class Memo:
    """Answers about campaigns, the latest asked for; however many ask, one of them works it out.

    Results are only ever added, so their number tells whether an answer is still true.

    Args:
        most: how many answers are kept.
    """

    def __init__(self, most: int = MOST) -> None:
        self._most = most
        self._lock = Lock()
        self._entries: OrderedDict[Hashable, Entry] = OrderedDict()

    def get(self, key: Hashable, results: int, make: Callable[[], Answer]) -> Answer:
        """The answer to a question, of so many results or of more."""
        entry = self._entry(key)
        with entry.lock:
            if entry.results < results:
                entry.answer, entry.results = make(), results
            answer: Answer = entry.answer
            return answer

    def known(self, key: Hashable, results: int) -> Any:
        """The answer if it is known; None otherwise."""
        entry = self._entry(key)
        with entry.lock:
            return entry.answer if entry.results >= results else None

    def put(self, key: Hashable, results: int, answer: object) -> None:
        """Keep an answer that was worked out elsewhere."""
        entry = self._entry(key)
        with entry.lock:
            if entry.results < results:
                entry.answer, entry.results = answer, results

    def _entry(self, key: Hashable) -> Entry:
        with self._lock:
            entry = self._entries.pop(key, None) or Entry()
            self._entries[key] = entry
            if len(self._entries) > self._most:
                self._entries.popitem(last=False)
            return entry
