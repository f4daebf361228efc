"""What a learner leaves behind when its process has ended by itself."""

import time
from collections.abc import Callable, Iterator
from pathlib import Path

import deadlines
import psutil
import pytest

from eigenfail.wire.messages import Stop
from eigenfail_services.hub import learner_link
from eigenfail_services.hub.learner_link import LearnerLink

WITHIN_S = deadlines.PROCESS_S

pytestmark = pytest.mark.service


def until(problem: str, holds: Callable[[], bool]) -> None:
    deadline_s = time.monotonic() + WITHIN_S
    while not holds():
        assert time.monotonic() < deadline_s, problem
        time.sleep(0.01)


def lives(process: psutil.Process) -> bool:
    return process.is_running() and process.status() != psutil.STATUS_ZOMBIE


@pytest.fixture
def leaving_program(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Learners start something, write down in this file what, and end at once."""
    script = tmp_path / "python"
    script.write_text(f"#!/bin/sh\nsleep 100000 & echo $! > {tmp_path}/started\nexit 4\n")
    script.chmod(0o700)
    monkeypatch.setattr(learner_link.sys, "executable", str(script))
    return tmp_path / "started"


@pytest.fixture
def leaving(leaving_program: Path) -> Iterator[LearnerLink]:
    link = LearnerLink()
    yield link
    link.stop()


def test_one_that_is_to_wait_begins_in_its_time_and_not_before(leaving_program) -> None:
    now_s = [100.0]
    link = LearnerLink(pause_s=5.0, clock=lambda: now_s[0])
    try:
        link.send(Stop())
        now_s[0] += 4.9
        assert (link.receive(), link.exit_status()) == (None, None)
        assert not leaving_program.exists()
        now_s[0] += 0.2
        until("it does not begin", lambda: link.exit_status() == 4)
        assert leaving_program.exists()
    finally:
        link.stop()


def test_one_that_is_stopped_before_its_time_never_begins(leaving_program) -> None:
    now_s = [100.0]
    link = LearnerLink(pause_s=5.0, clock=lambda: now_s[0])
    link.stop()
    assert not leaving_program.exists()


def test_what_a_learner_started_goes_with_it_though_it_ended_by_itself(leaving, tmp_path) -> None:
    until("it does not end", lambda: leaving.exit_status() is not None)
    assert leaving.exit_status() == 4
    left = psutil.Process(int((tmp_path / "started").read_text()))
    assert lives(left)
    leaving.stop()
    until("what it started lives on", lambda: not lives(left))
    assert leaving.exit_status() == 4
