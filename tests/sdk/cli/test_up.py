"""`eigenfail up` with stand-ins: what it prints, and how it ends."""

import json
import os
import signal
import time
from types import SimpleNamespace

import pytest
from typer.testing import CliRunner

from eigenfail.cli import up
from eigenfail.cli.main import app
from eigenfail.hosting.processes import find_marked

pytestmark = pytest.mark.service


INTERRUPT = "import os, signal; os.kill(os.getppid(), signal.SIGINT)\n"


@pytest.fixture
def run_up(stand_ins, tmp_path, monkeypatch):
    """Runs the command, and has it interrupted at its n-th look at the processes."""

    def run(*words, looks=3):
        left = iter(range(looks, 0, -1))

        def sleep(seconds):
            if next(left) == 1:
                os.kill(os.getpid(), signal.SIGTERM)
            time.sleep(seconds)

        monkeypatch.setattr(up, "time", SimpleNamespace(sleep=sleep))
        data = ("--data", str(tmp_path / "data"), "--port", "0")
        return CliRunner().invoke(app, ["up", *data, *words])

    return run


def test_it_says_where_it_is_and_ends_well(run_up, tmp_path):
    done = run_up()
    assert done.exit_code == 0, done.output
    assert "eigenfail is up at http://127.0.0.1:" in done.stdout
    assert "eigenfail worker --connect tcp://127.0.0.1:" in done.stdout
    assert len(done.stdout.splitlines()) == 2
    assert "continue at the next start" in done.stderr
    assert find_marked(str(tmp_path / "data")) == []


def test_programs_get_one_line_of_json(run_up):
    done = run_up("--json")
    assert done.exit_code == 0
    assert json.loads(done.stdout.strip()).keys() == {"url", "hub"}
    assert len(done.stdout.splitlines()) == 1


def test_on_request_it_repeats_what_its_processes_log(run_up):
    done = run_up("--verbose")
    assert done.exit_code == 0
    assert done.stdout.count("services: starting\n") == 1


def test_a_part_that_dies_ends_it_with_3_and_the_reason(run_up, stand_ins, tmp_path):
    dying = "time.sleep(0.1); raise SystemExit(print('eigenfail: It broke.') or 3)"
    stand_ins["services"] = stand_ins["services"].removesuffix("time.sleep(600)\n") + dying
    done = run_up(looks=1000)
    assert done.exit_code == 3
    assert "The services process ended by itself (exit code 3): It broke." in done.stderr
    assert find_marked(str(tmp_path / "data")) == []


def test_an_interruption_while_it_starts_ends_it_well(run_up, stand_ins, tmp_path):
    stand_ins["services"] = INTERRUPT + "import time; time.sleep(600)"
    done = run_up()
    assert done.exit_code == 0
    assert done.output == ""
    assert find_marked(str(tmp_path / "data")) == []
