"""A process that is asked something, and does not answer."""

import subprocess
import time
from collections.abc import Callable
from pathlib import Path

import psutil
import pytest

from eigenfail import side_process
from eigenfail.errors import ServiceError

WITHIN_S = 120.0


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

    monkeypatch.setattr(side_process.sys, "executable", str(script))
    monkeypatch.setattr(side_process.subprocess, "Popen", Slow)
    return file


@pytest.mark.service
def test_one_that_does_not_answer_is_killed_with_all_it_started(started) -> None:
    with pytest.raises(ServiceError, match=r"no answer within 0.2 s"):
        side_process.ask("module", b"question", patience_s=0.2)
    until("what it started lives on", lambda: not lives(int(started.read_text())))


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
