"""A process with a guard ends as it would without, and leaves nobody behind."""

import os
import signal
import subprocess
import sys

import deadlines
import psutil
import pytest

BEGIN = (
    "import os, signal, sys, time\nfrom eigenfail_workers.worker.guard import fork_under_guard\n"
)
ORPHAN = """
fork_under_guard()
if os.fork() == 0:
    os.setsid()
    if os.fork() == 0:
        sys.stdout.write(f"{os.getpid()} ")
        sys.stdout.flush()
        time.sleep(600)
    os._exit(0)
os.wait()
sys.stdin.read()
"""


def start(words: str) -> subprocess.Popen:
    return subprocess.Popen(
        [sys.executable, "-c", BEGIN + words], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    )


@pytest.mark.fault("SIGKILL of the guard of an inner process")
@pytest.mark.parametrize(
    ("end", "status"),
    [
        ("sys.exit(0)", 0),
        ("os._exit(7)", 7),
        ("os.kill(os.getpid(), signal.SIGSEGV)", -signal.SIGSEGV),
        ("os.kill(os.getpid(), signal.SIGKILL)", -signal.SIGKILL),
        ("raise KeyboardInterrupt", -signal.SIGINT),
    ],
)
def test_the_guard_ends_as_its_process_did(end, status) -> None:
    guard = start(f"fork_under_guard()\n{end}")
    guard.communicate()
    assert guard.returncode == status


def test_the_process_is_told_of_no_signal_that_is_the_guards() -> None:
    told = start(
        "fork_under_guard()\nprint(signal.pthread_sigmask(signal.SIG_BLOCK, []))"
    ).communicate()
    assert told[0].strip() == b"set()"


@pytest.mark.fault("planner that leaves processes behind")
@pytest.mark.parametrize("asked", [signal.SIGTERM, signal.SIGKILL, None])
def test_who_left_its_session_is_ended_too(asked, eventually) -> None:
    """By the guard, as it is asked to end; or as the process is killed, or ends by itself."""
    with start(ORPHAN) as guard:
        orphan = psutil.Process(int(read_word(guard.stdout)))
        if asked is signal.SIGTERM:
            guard.terminate()
        elif asked is signal.SIGKILL:
            first = psutil.Process(guard.pid).children()[0]
            eventually(lambda: orphan.ppid() == guard.pid)
            first.kill()
        else:
            guard.stdin.close()
        guard.wait(timeout=deadlines.PROCESS_S)
        assert not orphan.is_running()


@pytest.mark.fault("planner that leaves processes behind")
def test_the_dead_of_others_are_buried_while_the_process_lives(eventually) -> None:
    with start(ORPHAN) as guard:
        orphan = psutil.Process(int(read_word(guard.stdout)))
        eventually(lambda: orphan.ppid() == guard.pid)
        orphan.kill()
        eventually(lambda: not orphan.is_running())
        assert guard.poll() is None
    assert guard.returncode == 0


def read_word(pipe) -> bytes:
    word = b""
    while (letter := os.read(pipe.fileno(), 1)) != b" ":
        word += letter
    return word
