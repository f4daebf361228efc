"""Whether the process that holds a job is known to be dead."""

import os
import subprocess
import sys

import pytest

from eigenfail_services.campaigns import supervisor
from eigenfail_services.campaigns.supervisor import (
    find_place,
    is_lost,
    name_this_process,
    read_process,
)

NAMED = (
    "from eigenfail_services.campaigns.supervisor import name_this_process as name; print(name())"
)


@pytest.fixture
def other():
    """A process that lives until its input ends, and the name that it has."""
    command = [sys.executable, "-c", f"{NAMED}; import sys; sys.stdout.flush(); sys.stdin.read()"]
    process = subprocess.Popen(command, stdin=-1, stdout=-1, text=True)
    yield process, process.stdout.readline().strip()
    process.kill()
    process.communicate()


def test_we_are_not_lost():
    assert not is_lost(name_this_process())


def test_a_killed_process_is_lost_before_and_after_its_parent_has_seen_it(other):
    process, name = other
    assert not is_lost(name)
    process.kill()
    os.waitid(os.P_PID, process.pid, os.WEXITED | os.WNOWAIT)
    assert is_lost(name)
    process.wait()
    assert is_lost(name)


def test_another_process_with_its_number_is_not_it():
    name, _, started = name_this_process().rpartition(":")
    assert is_lost(f"{name}:{int(started) + 1}")


@pytest.mark.parametrize("told", ["", "host:1", "a:b:c", "elsewhere/boot/4026531836:1:55", "::"])
def test_of_others_nothing_is_known(told):
    assert not is_lost(told)


def test_where_the_kernel_tells_nothing_nobody_is_lost(monkeypatch, tmp_path, other):
    process, name = other
    process.kill()
    process.wait()
    monkeypatch.setattr(supervisor, "PROCESSES", tmp_path)
    assert read_process(os.getpid()) is None
    assert name_this_process() == f"{find_place()}:{os.getpid()}:"
    assert not is_lost(name_this_process())
    assert not is_lost(name)


def test_who_is_hidden_from_us_may_live(monkeypatch, other):
    process, name = other
    monkeypatch.setattr(supervisor, "read_process", lambda pid: None)
    assert not is_lost(name)
    process.kill()
    process.wait()
    assert is_lost(name)


def test_who_is_somebody_elses_and_hidden_lives(monkeypatch, other):
    def refuse(pid, signal):
        raise PermissionError

    with monkeypatch.context() as hidden:
        hidden.setattr(supervisor, "read_process", lambda pid: None)
        hidden.setattr(os, "kill", refuse)
        assert not is_lost(other[1])


def test_names_with_brackets_are_read(monkeypatch, tmp_path):
    monkeypatch.setattr(supervisor, "PROCESSES", tmp_path)
    (tmp_path / "7").mkdir()
    behind = " ".join(["S", *("0" for _ in range(18)), "4711", "0"])
    (tmp_path / "7" / "stat").write_text(f"7 (a) b (c)) {behind}")
    assert read_process(7) == ("S", "4711")
