"""What a learner leaves behind when its process has ended by itself."""

import time
from collections.abc import Callable, Iterator
from pathlib import Path

import psutil
import pytest

from eigenfail_services.hub import learner_link
from eigenfail_services.hub.learner_link import LearnerLink

WITHIN_S = 120.0

pytestmark = pytest.mark.service


def until(problem: str, holds: Callable[[], bool]) -> None:
    deadline_s = time.monotonic() + WITHIN_S
    while not holds():
        assert time.monotonic() < deadline_s, problem
        time.sleep(0.01)


def lives(process: psutil.Process) -> bool:
    return process.is_running() and process.status() != psutil.STATUS_ZOMBIE


@pytest.fixture
def leaving(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[LearnerLink]:
    """A learner that starts something, writes down what, and ends at once."""
    script = tmp_path / "python"
    script.write_text(f"#!/bin/sh\nsleep 100000 & echo $! > {tmp_path}/started\nexit 4\n")
    script.chmod(0o700)
    monkeypatch.setattr(learner_link.sys, "executable", str(script))
    link = LearnerLink()
    monkeypatch.undo()
    yield link
    link.stop()


def test_what_a_learner_started_goes_with_it_though_it_ended_by_itself(leaving, tmp_path) -> None:
    until("it does not end", lambda: leaving.exit_status() is not None)
    assert leaving.exit_status() == 4
    left = psutil.Process(int((tmp_path / "started").read_text()))
    assert lives(left)
    leaving.stop()
    until("what it started lives on", lambda: not lives(left))
    assert leaving.exit_status() == 4
