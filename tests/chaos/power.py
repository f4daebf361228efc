"""A disk that forgets, as the power goes, whatever was written and not brought to it.

What processes write and when they sync it is recorded by strace; the files of any moment between
are then made anew, from what was synced by then and as much of the rest as chance wants.
"""

import re
import subprocess
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from random import Random

import pytest

CALLS = "pwrite64,write,ftruncate,fsync,fdatasync,unlink"
SYNCS = frozenset({"fsync", "fdatasync"})
LONGEST = 1_000_000
SECTOR = 512
SHARED_MEMORY = "-shm"
"""SQLite's index of the log: made anew by whoever opens the file first."""

BEGUN = " <unfinished ...>"
LINE = re.compile(r"(?P<pid>\d+) +(?:<\.\.\. \w+ resumed>)?(?P<rest>.*)")
CALL = re.compile(r'(?P<name>\w+)\((?:\d+<(?P<path>[^>]*)>|"(?P<named>[^"]*)")(?P<more>.*)')
DATA = re.compile(r', "(?P<data>[^"]*)", \d+(?:, (?P<offset>\d+))?\) += (?P<done>\d+)$')
SIZE = re.compile(r", (?P<size>\d+)\) += 0$")


def recorder(log: Path) -> list[str]:
    """Words before a command: all that it writes and syncs is noted."""
    words = ["strace", "-f", "--seccomp-bpf", "-qq", "-y", "-xx", "-s", str(LONGEST)]
    try:
        subprocess.run([*words, "-o", "/dev/null", "true"], check=True, capture_output=True)
    except (OSError, subprocess.CalledProcessError):
        pytest.skip("no strace that may look into processes")
    return [*words, "-e", f"trace={CALLS}", "-o", str(log)]


@dataclass(frozen=True)
class Event:
    """Something that a process did to a file, or began to do.

    Attributes:
        what: `write`, `truncate`, `unlink`, `begin` (a sync that takes its time), `sync`.
        offset: where in the file; the new size, if it was truncated.
        by: the thread.
    """

    what: str
    path: str
    by: int
    offset: int | None = None
    data: bytes = b""


def recorded(log: Path) -> list[Event]:
    """What was noted; calls that failed, or that a kill cut short, did nothing."""
    return list(_events(log))


def _events(log: Path) -> Iterator[Event]:
    begun: dict[int, str] = {}
    with log.open() as lines:
        for line in lines:
            found = LINE.match(line.rstrip("\n"))
            pid, rest = int(found["pid"]), found["rest"]
            whole = rest if CALL.match(rest) else begun.pop(pid, "") + rest
            if whole.endswith(BEGUN):
                begun[pid] = whole = whole.removesuffix(BEGUN)
            yield from _event(pid, whole, is_begun=pid in begun)


def _event(pid: int, text: str, *, is_begun: bool) -> Iterator[Event]:
    call = CALL.match(text)
    if call is None:
        return
    path, more = plain(call["path"] or call["named"]).decode(), call["more"]
    if call["name"] in SYNCS:
        if is_begun or more.endswith("= 0"):
            yield Event("begin" if is_begun else "sync", path, pid)
    elif call["name"] == "unlink" and more.endswith("= 0"):
        yield Event("unlink", path, pid)
    elif size := SIZE.match(more):
        yield Event("truncate", path, pid, int(size["size"]))
    elif wrote := DATA.match(more):
        offset = None if wrote["offset"] is None else int(wrote["offset"])
        yield Event("write", path, pid, offset, plain(wrote["data"])[: int(wrote["done"])])


def plain(told: str) -> bytes:
    r"""Bytes that are told as \x61\x62; what is no file has a name without that."""
    return bytes.fromhex(told.replace("\\x", "")) if told.startswith("\\x") else told.encode()


@dataclass
class File:
    """What of a file is on the disk for good, and what is on its way, in order.

    Attributes:
        is_named: whether its folder was brought to disk since it was made.
        begun: how much was on its way when a thread began a sync that has not returned.
    """

    kept: bytearray = field(default_factory=bytearray)
    waiting: list[Event] = field(default_factory=list)
    is_named: bool = False
    begun: dict[int, int] = field(default_factory=dict)

    def sync(self, by: int) -> None:
        """What was written before the sync began is there for good."""
        until = self.begun.pop(by, len(self.waiting))
        for event in self.waiting[:until]:
            apply(self.kept, event)
        del self.waiting[:until]
        self.begun = {thread: max(0, n - until) for thread, n in self.begun.items()}

    def left(self, chance: Random | None) -> bytes:
        """Its content after a cut: nothing of what was on its way, or what chance wants of it."""
        content = bytearray(self.kept)
        for event in self.waiting if chance else ():
            for piece in sectors(event):
                if chance.random() < 0.5:
                    apply(content, piece)
        return bytes(content)


def sectors(event: Event) -> Iterator[Event]:
    """The parts of a write that come to disk each by itself."""
    for first in range(0, max(len(event.data), 1), SECTOR):
        part = event.data[first : first + SECTOR]
        yield Event(event.what, event.path, event.by, event.offset + first, part)


def apply(content: bytearray, event: Event) -> None:
    """Write it, or cut it to its size."""
    if event.what == "truncate":
        del content[event.offset :]
        return
    content.extend(bytes(max(0, event.offset - len(content))))
    content[event.offset : event.offset + len(event.data)] = event.data


class Disk:
    """The files of a folder as events befall them.

    Args:
        folder: whose events these are.
        image: what was in it before, all of it for good.
    """

    def __init__(self, folder: Path, image: Path) -> None:
        self._folder = folder
        self._files: defaultdict[str, File] = defaultdict(File)
        for path in image.iterdir():
            self._files[path.name] = File(bytearray(path.read_bytes()), is_named=True)

    def take(self, event: Event) -> None:
        """One more event; those of other folders are none of its business."""
        path = Path(event.path)
        if path == self._folder and event.what == "sync":
            for file in self._files.values():
                file.is_named = True
        elif path.parent == self._folder and not path.name.endswith(SHARED_MEMORY):
            self._befall(path.name, event)

    def _befall(self, name: str, event: Event) -> None:
        file = self._files[name]
        if event.what == "unlink":
            del self._files[name]
        elif event.what == "begin":
            file.begun[event.by] = len(file.waiting)
        elif event.what == "sync":
            file.sync(event.by)
        elif event.offset is not None:
            file.waiting.append(event)

    def lay_out(self, into: Path, chance: Random | None = None) -> None:
        """What is found after a cut at this moment."""
        into.mkdir()
        for name, file in self._files.items():
            if file.is_named:
                (into / name).write_bytes(file.left(chance))
