"""A process that is asked something, and does not answer."""

import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import deadlines
import msgspec
import psutil
import pytest

from eigenfail import processes
from eigenfail.errors import ServiceError

WITHIN_S = deadlines.PROCESS_S


@pytest.fixture
def started(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Who is asked starts another one and hangs; this is the file with that one's number.

    Nobody's patience begins before it is there, however slow the machine is.
    """
    file = tmp_path / "started"
    script = tmp_path / "python"
    script.write_text(
        f"#!/bin/sh\nsleep 100000 & echo $! > {tmp_path}/part && mv {tmp_path}/part {file}\nwait\n"
    )
    script.chmod(0o700)

    class Slow(subprocess.Popen):
        def __init__(self, *arguments, **named) -> None:
            super().__init__(*arguments, **named)
            until("it starts nothing", file.exists)

    monkeypatch.setattr(processes.sys, "executable", str(script))
    monkeypatch.setattr(processes.subprocess, "Popen", Slow)
    return file


@pytest.mark.fault(
    "calculation for a page that hangs",
    group="time",
    outcome="Its process is killed with all that it started, and the page shows an error.",
)
@pytest.mark.service
def test_one_that_does_not_answer_is_killed_with_all_it_started(started) -> None:
    with pytest.raises(ServiceError, match=r"no answer within 0.2 s"):
        processes.ask("module", b"question", patience_s=0.2)
    until("what it started lives on", lambda: not lives(int(started.read_text())))


ANSWERS = """#!{python}
import os, sys, time
sys.stdin.buffer.read()
if os.fork() == 0:
    for descriptor in (0, 1, 2):
        os.close(descriptor)
    time.sleep(600)
    os._exit(0)
{end}
"""


@pytest.fixture
def asked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[[str], list[int]]:
    """Has the module be a program that leaves a process behind and then ends in some way."""

    def put(end: str) -> None:
        script = tmp_path / "python"
        script.write_text(ANSWERS.format(python=sys.executable, end=end))
        script.chmod(0o700)
        monkeypatch.setattr(processes.sys, "executable", str(script))

    return put


def left_behind(folder: Path) -> list[psutil.Process]:
    """What runs a program of this folder."""
    mark = str(folder / "python")
    return [p for p in psutil.process_iter(["cmdline"]) if mark in (p.info["cmdline"] or [])]


@pytest.mark.service
def test_what_one_started_goes_though_it_answered_and_ended_by_itself(asked, tmp_path) -> None:
    answer = msgspec.msgpack.encode(processes.Answered(b"yes"))
    asked(f"os.write(1, {answer!r})")
    assert processes.ask("module", b"x" * 3_000_000, patience_s=WITHIN_S) == b"yes"
    until("what it started lives on", lambda: not any(map(lives_still, left_behind(tmp_path))))


@pytest.mark.service
@pytest.mark.parametrize(
    ("end", "said"),
    [
        ("sys.exit(5)", "exited with code 5"),
        ("os.kill(os.getpid(), 9)", "exited with code -9"),
        (r"os.write(1, b'\x92')", "was terminated"),
    ],
)
def test_one_that_breaks_off_is_told_of(asked, tmp_path, end, said) -> None:
    asked(end)
    with pytest.raises(ServiceError, match=said):
        processes.ask("module", b"question", patience_s=WITHIN_S)
    until("what it started lives on", lambda: not any(map(lives_still, left_behind(tmp_path))))


def lives_still(process: psutil.Process) -> bool:
    return lives(process.pid)


def until(problem: str, holds: Callable[[], bool]) -> None:
    deadline_s = time.monotonic() + WITHIN_S
    while not holds():
        assert time.monotonic() < deadline_s, problem
        time.sleep(0.01)


def lives(pid: int) -> bool:
    try:
        return psutil.Process(pid).status() != psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return False
