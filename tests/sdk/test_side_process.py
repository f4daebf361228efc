"""A process that is asked something, and does not answer."""

import time

import psutil
import pytest

from eigenfail import side_process
from eigenfail.errors import ServiceError


@pytest.mark.service
def test_one_that_does_not_answer_is_killed_with_all_it_started(tmp_path, monkeypatch) -> None:
    script = tmp_path / "python"
    script.write_text(f"#!/bin/sh\nsleep 100000 & echo $! > {tmp_path}/started\nwait\n")
    script.chmod(0o700)
    monkeypatch.setattr(side_process.sys, "executable", str(script))
    with pytest.raises(ServiceError, match=r"no answer within 2 s"):
        side_process.ask("module", b"question", patience_s=2.0)
    deadline_s = time.monotonic() + 60.0
    while lives(int((tmp_path / "started").read_text())):
        assert time.monotonic() < deadline_s, "what it started lives on"
        time.sleep(0.01)


def lives(pid: int) -> bool:
    try:
        return psutil.Process(pid).status() != psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return False
