"""Processes that die with the one that started them."""

import os
import select
import signal
import subprocess
import sys
import time

import deadlines
import pytest

from eigenfail.processes import PARENT_VARIABLE, as_parent, exit_status

PATIENCE_S = deadlines.PROCESS_S
DIES = "from eigenfail.processes import die_with_parent; die_with_parent()"
LIVES_ON = f"import os; {DIES}; print(os.environ.get({PARENT_VARIABLE!r}))"
STARTS = f"""
import os, subprocess, sys
from eigenfail.processes import as_parent
child = subprocess.Popen(
    [sys.executable, "-c", "import sys; {DIES}; print(flush=True); sys.stdin.read()"],
    stdin=subprocess.PIPE, stdout=subprocess.PIPE, env=os.environ | as_parent(),
)
child.stdout.readline()
print(child.pid, flush=True)
sys.stdin.read()
"""


def run(words, parent):
    command = [sys.executable, "-c", words]
    return subprocess.run(
        command, env=os.environ | parent, capture_output=True, text=True, check=False
    )


@pytest.mark.parametrize("parent", [{}, as_parent()])
def test_with_a_living_parent_it_goes_on_and_its_own_children_know_nothing(parent):
    done = run(LIVES_ON, parent)
    assert (done.returncode, done.stdout) == (0, "None\n")


def test_a_parent_that_died_before_the_kernel_was_asked_is_noticed():
    done = run(LIVES_ON, {PARENT_VARIABLE: str(os.getpid() + 1)})
    assert (done.returncode, done.stdout) == (128 + signal.SIGKILL, "")


def test_a_killed_parent_takes_its_child_with_it():
    parent = subprocess.Popen([sys.executable, "-c", STARTS], stdin=-1, stdout=-1, text=True)
    child = os.pidfd_open(int(parent.stdout.readline()))
    parent.kill()
    parent.communicate()
    try:
        assert select.select([child], [], [], PATIENCE_S)[0]
    finally:
        os.close(child)


@pytest.mark.parametrize(("end", "status"), [("sys.exit(3)", 3), ("os.kill(os.getpid(), 9)", -9)])
def test_how_a_process_ended_is_told_before_it_is_waited_for(end, status):
    command = [sys.executable, "-c", f"import os, sys; sys.stdin.read(); {end}"]
    process = subprocess.Popen(command, stdin=subprocess.PIPE)
    try:
        assert exit_status(process) is None
        process.stdin.close()
        deadline_s = time.monotonic() + PATIENCE_S
        while exit_status(process) is None:
            assert time.monotonic() < deadline_s
            time.sleep(0.01)
        assert (exit_status(process), process.returncode) == (status, None)
    finally:
        process.kill()
        process.wait()
    assert exit_status(process) == status
