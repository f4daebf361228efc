"""Logs of bounded size: what is too long is moved aside, and of that the newest is kept."""

import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from threading import Event, Thread

MAX_BYTES = 10_000_000
FILES = 5
"""Of one log, the one that is written to among them."""

EVERY_S = 1.0
CHUNK = 1 << 20


class Log:
    """A file to which processes append, and all of whose writers opened it to append.

    It is never renamed: whoever writes goes on in the same file. What is written in the instant
    between its last byte's copy and its emptying is lost.
    """

    def __init__(self, path: Path) -> None:
        self.path = path

    def older(self, number: int) -> Path:
        """What was moved aside; 1 is the newest."""
        return self.path.with_name(f"{self.path.name}.{number}")

    def rotate(self) -> bool:
        """Empty the file if it is too long, and keep its last part; whether it was emptied.

        Raises:
            OSError: there is no room for a copy; everything is as before.
        """
        if not self.path.exists() or self.path.stat().st_size <= MAX_BYTES:
            return False
        draft = self.path.with_name(f"{self.path.name}.new")
        with self.path.open("rb") as source:
            try:
                copy_end(source.fileno(), draft)
            except OSError:
                draft.unlink(missing_ok=True)
                raise
            for number in range(FILES - 1, 1, -1):
                with suppress(FileNotFoundError):
                    self.older(number - 1).replace(self.older(number))
            draft.replace(self.older(1))
            os.truncate(self.path, 0)
        return True


def copy_end(source: int, draft: Path) -> None:
    """The last bytes of an open file, at most as many as a log may have, to another."""
    os.lseek(source, max(0, os.fstat(source).st_size - MAX_BYTES), os.SEEK_SET)
    with draft.open("wb") as target:
        while data := os.read(source, CHUNK):
            target.write(data)


@contextmanager
def bounded(rotations: Sequence[Callable[[], object]]) -> Iterator[None]:
    """Rotate logs, each second, for as long as the block lasts."""
    over = Event()

    def watch() -> None:
        while not over.wait(EVERY_S):
            for rotate in rotations:
                with suppress(OSError):  # no room: nothing grows either, and it is tried again
                    rotate()

    thread = Thread(target=watch, name="logs", daemon=True)
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join()
