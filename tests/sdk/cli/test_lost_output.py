"""Standard output that cannot be written: one sentence and an exit code, never a traceback."""

import subprocess
import sys
from pathlib import Path

import deadlines
import psutil
import pytest

from eigenfail.cli.main import COMMANDS

pytestmark = pytest.mark.service

PROGRAM = [sys.executable, "-c", "from eigenfail.cli.main import main; main()"]
FULL = Path("/dev/full")
PATIENCE_S = deadlines.PROCESS_S
LINES = [["--version"], ["--help"], ["doctor", "--json"], ["db", "current"]]


def run(words: list[str], stdout, folder: Path, **more) -> "subprocess.CompletedProcess[str]":
    return subprocess.run(
        [*PROGRAM, *words],
        stdout=stdout,
        text=True,
        cwd=folder,
        timeout=PATIENCE_S,
        check=False,
        **{"stderr": subprocess.PIPE} | more,
    )


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """Where there is a database."""
    folder = tmp_path_factory.mktemp("commands")
    assert run(["db", "upgrade"], subprocess.DEVNULL, folder).returncode == 0
    return folder


@pytest.mark.skipif(not FULL.exists(), reason="/dev/full is Linux's")
@pytest.mark.fault(
    "standard output on a full disk",
    group="processes",
    outcome="The command says so in one sentence and exits with 3; what it started is ended.",
)
@pytest.mark.parametrize("words", LINES, ids=" ".join)
def test_a_full_disk_is_one_sentence(folder, words) -> None:
    with FULL.open("w") as stdout:
        done = run(words, stdout, folder)
    assert done.returncode == 3
    assert done.stderr.count("\n") == 1, done.stderr
    assert "Standard output cannot be written: No space left on device." in done.stderr


@pytest.mark.skipif(not FULL.exists(), reason="/dev/full is Linux's")
@pytest.mark.fault("standard output on a full disk")
def test_the_help_of_every_command_is_checked(folder) -> None:
    for name in sorted(COMMANDS)[::5]:
        with FULL.open("w") as stdout:
            done = run([name, "--help"], stdout, folder)
        assert (done.returncode, done.stderr.count("\n")) == (3, 1), done.stderr


@pytest.mark.skipif(not FULL.exists(), reason="/dev/full is Linux's")
@pytest.mark.fault("standard output on a full disk")
def test_a_service_that_cannot_say_where_it_is_ends(folder) -> None:
    words = ["up", "--launcher", "none", "--port", "0", "--data", "unsaid"]
    with FULL.open("w") as stdout:
        done = run(words, stdout, folder)
    # On a slow machine, lines before say how long it has been starting.
    complaints = [line for line in done.stderr.splitlines() if not line.endswith("s so far.")]
    assert (done.returncode, len(complaints)) == (3, 1), done.stderr
    there = str(folder / "unsaid")
    assert not [
        process.pid
        for process in psutil.process_iter(["cmdline"])
        if any(there in word for word in process.info["cmdline"] or [])
    ]


@pytest.mark.fault(
    "standard output that nobody reads any more",
    group="processes",
    outcome="The command ends in silence with exit code 141, as other programs do in a pipeline.",
)
@pytest.mark.parametrize("words", LINES, ids=" ".join)
def test_a_closed_pipe_ends_a_command_in_silence(folder, words) -> None:
    with subprocess.Popen(["true"], stdin=subprocess.PIPE) as reader:
        assert reader.wait(PATIENCE_S) == 0
        done = run(words, reader.stdin, folder)
    assert (done.returncode, done.stderr) == (141, "")


@pytest.mark.skipif(not FULL.exists(), reason="/dev/full is Linux's")
@pytest.mark.fault("standard output on a full disk")
def test_where_nothing_can_be_said_the_exit_code_remains(folder) -> None:
    with FULL.open("w") as full:
        assert run(["--version"], full, folder, stderr=full).returncode == 3
