"""Whoever dies, nothing of a service outlives it."""

import os
import signal
import subprocess
import sys

import deadlines
import psutil
import pytest

from eigenfail.hosting.processes import OWNER_MARK, guard_owner, remove_afterwards

WITHIN_S = deadlines.PROCESS_S

pytestmark = pytest.mark.service

STARTS_AND_WAITS = """
import os, subprocess, sys
from pathlib import Path
from eigenfail.hosting.processes import OWNER_MARK
from eigenfail.hosting.processes import remove_afterwards

folder = Path(sys.argv[1])
with remove_afterwards(folder):
    environment = os.environ | {OWNER_MARK: str(folder)}
    left = subprocess.Popen(
        [sys.executable, "-c", "import time; time.sleep(600)"],
        env=environment, start_new_session=True, stdout=subprocess.DEVNULL,
    )
    print(left.pid, flush=True)
    sys.stdin.read()
"""


@pytest.fixture
def program(tmp_path):
    """A program that has started a process for a folder, and waits; with that process."""
    folder = tmp_path / "data"
    folder.mkdir()
    (folder / "eigenfail.db").write_text("")
    process = subprocess.Popen(
        [sys.executable, "-c", STARTS_AND_WAITS, folder],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    left = psutil.Process(int(process.stdout.readline()))
    yield process, left, folder
    process.kill()
    process.communicate()
    if left.is_running():
        left.kill()


def gone(path):
    import time

    deadline = time.monotonic() + WITHIN_S
    while path.exists() and time.monotonic() < deadline:
        time.sleep(0.05)
    return not path.exists()


@pytest.mark.fault(
    "SIGKILL of the program that started a service",
    group="processes",
    outcome="A guard process ends all that is left of the service and removes its temporary "
    "folder.",
)
@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM])
def test_what_a_killed_program_left_is_ended_and_its_folder_removed(program, number):
    process, left, folder = program
    process.send_signal(number)
    left.wait(WITHIN_S)
    assert gone(folder)


def test_a_folder_is_gone_after_its_block(tmp_path):
    folder = tmp_path / "data"
    folder.mkdir()
    with remove_afterwards(folder):
        assert folder.exists()
    assert not folder.exists()


def test_a_block_that_ends_well_ends_nobody(tmp_path):
    owner = str(tmp_path)
    mine = subprocess.Popen(
        [sys.executable, "-c", "import time; time.sleep(600)"],
        env=os.environ | {OWNER_MARK: owner},
    )
    try:
        with guard_owner(owner):
            pass
        assert mine.poll() is None
    finally:
        mine.kill()
        mine.wait()
