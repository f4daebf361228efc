"""Processes that the command line starts, and their end: nothing may be left running."""

import os
import subprocess
import time
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from types import MappingProxyType

import psutil

from eigenfail.errors import ServiceError
from eigenfail.hosting.logs import Log
from eigenfail.hosting.signals import handled

OWNER_MARK = "EIGENFAIL_STARTED_FOR"
POLL_S = 0.05
GRACE_S = 20.0
LAST_LINES = 12
REFUSED = frozenset({2, 3})
KILL_WITHIN_S = 5.0
NOTHING: Mapping[str, str] = MappingProxyType({})


class Part:
    """One process of the service; what it says goes to a file.

    It has a session of its own, so that Ctrl-C in the terminal reaches only the command line, which
    then ends its parts in order. Everything it starts inherits a mark by which it is found again.
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
        marks = {OWNER_MARK: owner, "PYTHONUNBUFFERED": "1"}
        environment = os.environ | marks | dict(variables)
        with log.open("ab") as stream:
            self.process = subprocess.Popen(
                command,
                stdin=subprocess.DEVNULL,
                stdout=stream,
                stderr=subprocess.STDOUT,
                env=environment,
                start_new_session=True,
            )

    def said(self) -> list[str]:
        """The lines it has written so far, as far as its log still has them."""
        return self._read(self._start).decode(errors="replace").splitlines()

    def news(self) -> list[str]:
        """The whole lines that it has written since this was last asked."""
        lines, newline, _ = self._read(self._told).rpartition(b"\n")
        self._told += len(lines) + len(newline)
        return lines.decode(errors="replace").splitlines()

    def rotate(self) -> None:
        """Move what is in the log aside if it has become too long.

        Raises:
            OSError: there is no room for it.
        """
        if Log(self.log).rotate():
            self._start = self._told = 0

    def _read(self, start: int) -> bytes:
        with self.log.open("rb") as stream:
            stream.seek(start)
            return stream.read()

    def check(self) -> None:
        """Raises ServiceError if the process has ended by itself, with what it said last."""
        code = self.process.poll()
        if code is not None:
            ended = f"The {self.name} process ended by itself (exit code {code})"
            remedy = f"The whole log is in {self.log}."
            raise ServiceError(f"{ended}: {self.last_words(code)}", remedy)

    def last_words(self, code: int) -> str:
        """The one sentence with which it refused, or else its last lines."""
        said = self.said()
        if code in REFUSED and said:
            return said[-1].removeprefix("eigenfail: ")
        return "".join(f"\n  {line}" for line in said[-LAST_LINES:]) + "\n"


def marked(owner: str) -> list[psutil.Process]:
    """Every living process that was started for this owner, and all their descendants."""
    found: dict[int, psutil.Process] = {}
    for process in psutil.process_iter():
        with suppress(psutil.Error, OSError):
            if bears_mark(process.pid, owner):
                found[process.pid] = process
                found |= {child.pid: child for child in process.children(recursive=True)}
    found.pop(os.getpid(), None)
    return list(found.values())


def bears_mark(pid: int, owner: str) -> bool:
    """Whether the process was started with the owner's mark; raises OSError if it is not ours.

    Processes that rename themselves, as Ray's do, overwrite the beginning of their environment:
    whoever parses it stops there, so the mark is looked for as it stands.
    """
    mark = f"{OWNER_MARK}={owner}".encode()
    return mark in Path(f"/proc/{pid}/environ").read_bytes().split(b"\0")


def stop(parts: Sequence[Part], owner: str, grace_s: float = GRACE_S) -> None:
    """End the parts politely, then whatever is left of them; a second signal ends the patience."""
    deadline = [time.monotonic() + grace_s]

    def hurry(*_: object) -> None:
        deadline[0] = time.monotonic()

    with handled(hurry):
        family = marked(owner)
        for part in parts:
            part.process.terminate()
        while any(part.process.poll() is None for part in parts) and time.monotonic() < deadline[0]:
            time.sleep(POLL_S)
        end(family)
        end_marked(owner)
        for part in parts:
            part.process.wait()


def end_marked(owner: str) -> None:
    """Kill whatever bears the owner's mark, until nothing does."""
    deadline = time.monotonic() + KILL_WITHIN_S
    while (left := marked(owner)) and time.monotonic() < deadline:
        end(left)
        time.sleep(POLL_S)


def end(processes: Iterable[psutil.Process]) -> None:
    """Kill these, if they are still what they were."""
    for process in processes:
        with suppress(psutil.Error):
            process.kill()
