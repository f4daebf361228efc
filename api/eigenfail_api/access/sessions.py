"""Browsers that are signed in: a cookie with a random word stands for a key.

The words are in this process alone: after a restart, people sign in again.
"""

import secrets
from dataclasses import dataclass
from threading import Lock

COOKIE = "eigenfail_session"
LIFE_S = 12 * 3_600
MOST = 1_000
WORD_BYTES = 32


@dataclass(frozen=True)
class Session:
    """The key that a word stands for, and until when."""

    key: int
    ends_ms: int


class Sessions:
    """Those that are open; the oldest makes room for one too many."""

    def __init__(self) -> None:
        self._lock = Lock()
        self._open: dict[str, Session] = {}

    def open(self, key: int, at_ms: int) -> str:
        """A new session for the holder of a key; the word that stands for it."""
        word = secrets.token_urlsafe(WORD_BYTES)
        with self._lock:
            while len(self._open) >= MOST:
                del self._open[next(iter(self._open))]
            self._open[word] = Session(key, at_ms + 1_000 * LIFE_S)
        return word

    def key_of(self, word: str, at_ms: int) -> int | None:
        """The key that a word stands for at a moment, if it is one."""
        with self._lock:
            found = self._open.get(word)
            if found is not None and at_ms >= found.ends_ms:
                del self._open[word]
                return None
        return None if found is None else found.key

    def close(self, word: str) -> None:
        """The word stands for nothing any more."""
        with self._lock:
            self._open.pop(word, None)
