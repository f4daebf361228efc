"""Processes that the command line starts, their bounded logs, and their end.

No process may be left running. On Ctrl-C, SIGTERM or a closed terminal, the command line stops the
processes that it started, then ends.
"""

import os
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from threading import Event, Thread
from types import MappingProxyType
from typing import Any

import psutil

from eigenfail.errors import ServiceError
from eigenfail.files import open_private

STOP_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


@contextmanager
def handle_signals(handler: Callable[..., Any]) -> Iterator[None]:
    """Send stop signals to a handler within the block; outside the main thread, do nothing."""
    # Python refuses to set a handler elsewhere, and a service may be started from any thread.
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = {number: signal.signal(number, handler) for number in STOP_SIGNALS}
    try:
        yield
    finally:
        for number, previous in before.items():
            signal.signal(number, previous)


def interruptible() -> Any:
    """Return a context that turns each stop signal into KeyboardInterrupt."""

    def interrupt(*_: object) -> None:
        raise KeyboardInterrupt

    return handle_signals(interrupt)


MAX_BYTES = 10_000_000


FILES = 5
"""Of one log, the one that is written to among them."""


EVERY_S = 1.0


CHUNK = 1 << 20


class Log:
    """A log file that several processes append to; it is emptied, never renamed.

    It is not renamed because its writers continue in the same file. Text that is written between
    the copy of the last byte and the truncation is lost.
    """

    def __init__(self, path: Path) -> None:
        self.path = path

    def older(self, number: int) -> Path:
        """Return the path of a rotated log; 1 is the newest."""
        return self.path.with_name(f"{self.path.name}.{number}")

    def rotate(self) -> bool:
        """Empty the file if it is too long, and keep its last part; return whether it was emptied.

        Raises:
            OSError: the disk has too little space for a copy; nothing has changed.
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
            # The oldest first, which makes room for the next one.
            for number in range(FILES - 1, 1, -1):
                with suppress(FileNotFoundError):
                    self.older(number - 1).replace(self.older(number))
            draft.replace(self.older(1))
            os.truncate(self.path, 0)
        return True


def copy_end(source: int, draft: Path) -> None:
    """Copy the last bytes of an open file, at most the size limit of a log, to another file."""
    os.lseek(source, max(0, os.fstat(source).st_size - MAX_BYTES), os.SEEK_SET)
    with open_private(draft, "wb") as target:
        while data := os.read(source, CHUNK):
            target.write(data)


@contextmanager
def rotate_regularly(rotations: Sequence[Callable[[], object]]) -> Iterator[None]:
    """Rotate logs each second for as long as the block lasts."""
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


OWNER_MARK = "EIGENFAIL_STARTED_FOR"


POLL_S = 0.05


GRACE_S = 20.0


LAST_LINES = 12


REFUSED = frozenset({2, 3})


KILL_WITHIN_S = 5.0


NOTHING: Mapping[str, str] = MappingProxyType({})


class ServicePart:
    """One process of the service; its output goes to a file.

    It runs in a separate session, so that Ctrl-C in the terminal reaches only the command line,
    which then ends its parts in order. All processes that it starts inherit a mark, so that they
    can be found again.
    """

    def __init__(
        self,
        name: str,
        command: Sequence[str],
        log: Path,
        owner: str,
        variables: Mapping[str, str] = NOTHING,
    ) -> None:
        self.name = name
        self.log = log
        with suppress(OSError):
            Log(log).rotate()
        self._start = self._told = log.stat().st_size if log.exists() else 0
        # Unbuffered, as `wait_until_ready` reads what a part prints while it runs.
        marks = {OWNER_MARK: owner, "PYTHONUNBUFFERED": "1"}
        environment = os.environ | marks | dict(variables)
        with open_private(log, "ab") as stream:
            self.process = subprocess.Popen(
                command,
                stdin=subprocess.DEVNULL,
                stdout=stream,
                stderr=subprocess.STDOUT,
                env=environment,
                start_new_session=True,
            )

    def said(self) -> list[str]:
        """Return the lines that it has written so far and that are still in its log."""
        return self._read(self._start).decode(errors="replace").splitlines()

    def news(self) -> list[str]:
        """Return the complete lines that it has written since the last call."""
        lines, newline, _ = self._read(self._told).rpartition(b"\n")
        self._told += len(lines) + len(newline)
        return lines.decode(errors="replace").splitlines()

    def rotate(self) -> None:
        """Move the log aside if it has become too long.

        Raises:
            OSError: the disk has too little space.
        """
        if Log(self.log).rotate():
            self._start = self._told = 0

    def _read(self, start: int) -> bytes:
        with self.log.open("rb") as stream:
            stream.seek(start)
            return stream.read()

    def check(self) -> None:
        """Raise ServiceError with the last output if the process has ended by itself."""
        code = self.process.poll()
        if code is not None:
            ended = f"The {self.name} process ended by itself (exit code {code})"
            remedy = f"The whole log is in {self.log}."
            raise ServiceError(f"{ended}: {self.last_words(code)}", remedy)

    def last_words(self, code: int) -> str:
        """Return the sentence of the process's refusal, or else its last lines."""
        said = self.said()
        if code in REFUSED and said:
            return said[-1].removeprefix("eigenfail: ")
        return "".join(f"\n  {line}" for line in said[-LAST_LINES:]) + "\n"


def find_marked(owner: str) -> list[psutil.Process]:
    """Return every living process that was started for this owner, with all descendants."""
    found: dict[int, psutil.Process] = {}
    for process in psutil.process_iter():
        with suppress(psutil.Error, OSError):
            if _bears_mark(process.pid, owner):
                found[process.pid] = process
                found |= {child.pid: child for child in process.children(recursive=True)}
    found.pop(os.getpid(), None)
    return list(found.values())


def _bears_mark(pid: int, owner: str) -> bool:
    """Return whether a process has the owner's mark; raise OSError for another user's process.

    Processes that rename themselves, as Ray's do, overwrite the beginning of their environment:
    a parser stops there, so the mark is searched for as plain text.
    """
    mark = f"{OWNER_MARK}={owner}".encode()
    return mark in Path(f"/proc/{pid}/environ").read_bytes().split(b"\0")


def stop_parts(parts: Sequence[ServicePart], owner: str, grace_s: float = GRACE_S) -> None:
    """Stop the parts by SIGTERM, then kill the remaining ones; a second signal kills at once."""
    deadline = [time.monotonic() + grace_s]

    def hurry(*_: object) -> None:
        deadline[0] = time.monotonic()

    with handle_signals(hurry):
        # Before the parts end: afterwards their children have another parent, and those that
        # replaced their environment could no longer be found.
        family = find_marked(owner)
        for part in parts:
            part.process.terminate()
        while any(part.process.poll() is None for part in parts) and time.monotonic() < deadline[0]:
            time.sleep(POLL_S)
        _kill(family)
        kill_marked(owner)
        for part in parts:
            part.process.wait()


def kill_marked(owner: str) -> None:
    """Kill the processes that carry the owner's mark, until none is left."""
    deadline = time.monotonic() + KILL_WITHIN_S
    while (left := find_marked(owner)) and time.monotonic() < deadline:
        _kill(left)
        time.sleep(POLL_S)


def _kill(processes: Iterable[psutil.Process]) -> None:
    """Kill processes, except a process whose number now belongs to another one."""
    for process in processes:
        with suppress(psutil.Error):
            process.kill()


ALL_WELL = b"all is well\n"


REMOVE = "--remove"


@contextmanager
def remove_afterwards(folder: Path) -> Iterator[None]:
    """Remove a folder, and end the processes that run on it, after the block in any case."""
    with guard_owner(str(folder), REMOVE):
        try:
            yield
        finally:
            shutil.rmtree(folder, ignore_errors=True)


@contextmanager
def guard_owner(owner: str, *options: str) -> Iterator[None]:
    """Start a guard that ends the owner's processes if this process dies within the block.

    Args:
        owner: mark of the processes.
        options: options of the guard: with `REMOVE` the owner is a folder, which the guard removes.
    """
    # With the mark, the guard would be among the processes that it kills.
    unmarked = {name: text for name, text in os.environ.items() if name != OWNER_MARK}
    process = subprocess.Popen(
        [sys.executable, "-m", __name__, owner, *options],
        stdin=subprocess.PIPE,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        env=unmarked,
        start_new_session=True,
    )
    try:
        yield
    finally:
        process.communicate(ALL_WELL)


def main() -> None:
    """Wait until the guarded process ends; unless it ended in order, clean up after it."""
    if sys.stdin.buffer.read() == ALL_WELL:
        return
    owner = sys.argv[1]
    kill_marked(owner)
    if REMOVE in sys.argv[2:]:
        shutil.rmtree(owner, ignore_errors=True)


if __name__ == "__main__":
    main()
