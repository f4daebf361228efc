"""The logs of a service: they are cut while they are written to, and never grow for ever."""

import sys
import time

import deadlines
import pytest

from eigenfail.hosting import processes
from eigenfail.hosting.processes import Log, ServicePart, rotate_regularly, stop_parts

PATIENCE_S = deadlines.PROCESS_S

WRITER = """
import os, subprocess, sys, time
print("line\\n" * 5_000, end="", flush=True)
while not os.path.exists({go!r}):
    time.sleep(0.01)
print("after", flush=True)
subprocess.run([sys.executable, "-c", "print('a grandchild')"])
"""


@pytest.fixture
def small(monkeypatch):
    """Logs of at most 10 kB."""
    monkeypatch.setattr(processes, "MAX_BYTES", 10_000)


@pytest.fixture
def start(tmp_path):
    """Starts Python on a piece of code as a part of a service."""
    parts = []

    def start(code):
        owner = str(tmp_path)
        parts.append(
            ServicePart("part", [sys.executable, "-c", code], tmp_path / "part.log", owner)
        )
        return parts[-1]

    yield start
    stop_parts(parts, str(tmp_path), grace_s=0.0)


def until(done):
    """Wait for something that is bound to happen."""
    deadline_s = time.monotonic() + PATIENCE_S
    while not done():
        assert time.monotonic() < deadline_s
        time.sleep(0.01)


def files(folder):
    return sorted(path.name for path in folder.glob("part.log*"))


def test_who_writes_goes_on_in_the_same_file_and_the_newest_is_kept(small, tmp_path):
    log = Log(tmp_path / "part.log")
    with log.path.open("ab", buffering=0) as writer:
        for number in range(8):
            writer.write(b"%d" % number * 12_000)
            assert log.rotate()
        writer.write(b"8")
    assert log.path.read_bytes() == b"8"
    older = [log.older(number).read_bytes() for number in range(1, processes.FILES)]
    assert older == [b"%d" % number * processes.MAX_BYTES for number in (7, 6, 5, 4)]
    assert files(tmp_path) == ["part.log", *(f"part.log.{n}" for n in range(1, processes.FILES))]


def test_the_log_of_a_process_is_cut_while_it_runs(*, small, start, tmp_path, monkeypatch):
    monkeypatch.setattr(processes, "EVERY_S", 0.01)
    go = tmp_path / "go"
    part = start(WRITER.format(go=str(go)))
    with rotate_regularly([part.rotate]):
        until(lambda: Log(part.log).older(1).exists() and not part.log.stat().st_size)
        go.touch()
        assert part.process.wait(PATIENCE_S) == 0
    assert part.said() == part.news() == ["after", "a grandchild"]


def test_a_log_of_an_earlier_start_is_cut_before_the_next(small, start, tmp_path):
    (tmp_path / "part.log").write_text("old\n" * 5_000)
    part = start("print('new')")
    assert part.process.wait(PATIENCE_S) == 0
    assert part.said() == ["new"]
    assert part.log.read_text() == "new\n"
    assert Log(part.log).older(1).stat().st_size == processes.MAX_BYTES


def test_a_short_log_is_left_alone(small, tmp_path):
    (tmp_path / "part.log").write_text("short\n")
    assert not Log(tmp_path / "part.log").rotate()
    assert not Log(tmp_path / "none.log").rotate()
    assert files(tmp_path) == ["part.log"]


def test_without_room_for_a_copy_nothing_is_lost(small, tmp_path, monkeypatch):
    (tmp_path / "part.log").write_text("old\n" * 5_000)

    def full(_source, draft):
        draft.write_text("half")
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(processes, "copy_end", full)
    with pytest.raises(OSError, match="No space left"):
        Log(tmp_path / "part.log").rotate()
    assert files(tmp_path) == ["part.log"]
    assert (tmp_path / "part.log").stat().st_size == 20_000
