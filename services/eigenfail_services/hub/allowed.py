"""A worker's file in the hub's folder: one key on a line, and one more while it is being renewed.

Each line holds the public key, when it was made and until when it is let in, in milliseconds since
1970; a dash is for ever. The times may be missing: so a key can be put there by hand.
"""

from collections.abc import Iterable, Iterator
from pathlib import Path

import msgspec

from eigenfail.private_files import replace_private
from eigenfail.wire.curve import KEY_BYTES, AllowedWorker, fingerprint, from_text, to_text

FOR_EVER = "-"


class Allowed(msgspec.Struct, frozen=True):
    """A public key, of whom, and from when to when it is let in. [ms since 1970]"""

    name: str
    public: bytes
    made_ms: int
    until_ms: int | None = None

    def is_valid(self, at_ms: int) -> bool:
        """Whether it is let in at a moment."""
        return self.until_ms is None or at_ms < self.until_ms

    def ending(self, at_ms: int) -> "Allowed":
        """The same, let in no longer than until a moment."""
        until_ms = at_ms if self.until_ms is None else min(at_ms, self.until_ms)
        return msgspec.structs.replace(self, until_ms=until_ms)

    def line(self) -> str:
        """As it is kept."""
        until = FOR_EVER if self.until_ms is None else str(self.until_ms)
        return f"{to_text(self.public)} {self.made_ms} {until}"

    def told(self) -> AllowedWorker:
        """As it is listed."""
        return AllowedWorker(self.name, fingerprint(self.public), self.made_ms, self.until_ms)


def read_allowed(file: Path) -> Iterator[Allowed]:
    """The keys in a file; a line that is none is passed over.

    Raises:
        OSError: it cannot be read.
    """
    made_ms = round(1_000 * file.stat().st_mtime)
    for line in file.read_text(errors="replace").splitlines():
        words = line.split()
        public = from_text(words[0], KEY_BYTES) if words else None
        if public is not None:
            yield Allowed(file.name, public, *times(words[1:], made_ms))


def times(words: list[str], made_ms: int) -> tuple[int, int | None]:
    """When a key was made, and until when it is let in; what cannot be read has passed."""
    if not words:
        return made_ms, None
    made, until, *_ = *words, FOR_EVER
    whole = int(until) if until.isdecimal() else 0
    return int(made) if made.isdecimal() else made_ms, None if until == FOR_EVER else whole


def write_allowed(file: Path, keys: Iterable[Allowed], field: str) -> None:
    """Write a worker's file, all of it or nothing.

    Raises:
        InvalidValue: it cannot be written.
    """
    replace_private(file, "\n".join(key.line() for key in keys), field)
