"""The commands as a user types them, with real processes: a service of their own, and its end."""

import json
import os
import re
import signal
import subprocess
import sys
from pathlib import Path

import deadlines
import psutil
import pytest

from eigenfail.hosting.processes import find_marked

pytestmark = pytest.mark.service

EIGENFAIL = Path(sys.executable).parent / "eigenfail"
SET_BY_USERS = ("EIGENFAIL_URL", "EIGENFAIL_DATA")


@pytest.fixture
def data(tmp_path):
    return tmp_path / "data"


@pytest.fixture
def start(tmp_path):
    """Starts a command; whatever a test leaves of it is ended."""
    started = []

    def command(*words):
        environment = {name: text for name, text in os.environ.items() if name not in SET_BY_USERS}
        process = subprocess.Popen(
            [EIGENFAIL, *map(str, words)],
            cwd=tmp_path,
            env=environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        started.append(process)
        return process

    yield command
    for process in started:
        if process.poll() is None:
            process.terminate()
        process.communicate(timeout=deadlines.PROCESS_S)


@pytest.fixture
def up(start, data):
    """A service without workers; its addresses come with the process."""

    def begin():
        words = ("--port", 0, "--launcher", "none", "--data", data, "--json")
        process = start("up", *words)
        line = process.stdout.readline()
        assert line, process.stderr.read()
        return process, json.loads(line)

    return begin


def owner(data):
    return str(data.resolve())


def test_run_starts_what_is_missing_and_leaves_nothing(start, spec_file, data):
    process = start("run", spec_file, "--data", data, "--json", "--workers", 1)
    out, err = process.communicate(timeout=deadlines.PROCESS_S)
    assert process.returncode == 0, err
    assert json.loads(out)["counts"]["completed"] == 24
    assert find_marked(owner(data)) == []
    assert "The service that was started for this campaign has ended." in err
    assert f"start one in a second terminal: eigenfail up --data {data}" in err


@pytest.mark.fault("SIGTERM or Ctrl-C of a service, once or twice")
def test_run_uses_the_service_of_the_folder_and_ctrl_c_pauses(start, up, spec_file, data):
    service, address = up()
    worker = start("worker", "--connect", address["hub"], "--json")
    run = start("run", spec_file, "--data", data, "--episodes", 100_000)
    seen = ""
    while not re.search(r": [1-9]\d*/100000 episodes", seen):
        seen = run.stderr.readline()
        assert seen
    run.send_signal(signal.SIGINT)
    _, err = run.communicate(timeout=deadlines.PROCESS_S)
    assert run.returncode == 130
    assert "Campaign 1 is paused after" in err
    assert "eigenfail campaign resume 1" in err

    replayed = start("episode", "replay", "1/0", "--url", address["url"])
    assert replayed.wait(timeout=deadlines.PROCESS_S) == 0

    worker.send_signal(signal.SIGTERM)
    assert worker.wait(timeout=deadlines.PROCESS_S) == 0
    service.send_signal(signal.SIGTERM)
    assert service.wait(timeout=deadlines.PROCESS_S) == 0
    assert find_marked(owner(data)) == []


@pytest.mark.fault("SIGKILL of the services")
def test_up_notices_that_a_part_was_killed(up, data):
    service, _ = up()
    (services,) = [
        process
        for process in psutil.Process(service.pid).children()
        if "eigenfail_services" in process.cmdline()
    ]
    services.kill()
    _, err = service.communicate(timeout=deadlines.PROCESS_S)
    assert service.returncode == 3
    assert "The services process ended by itself (exit code -9)" in err
    assert "Traceback" not in err
    assert find_marked(owner(data)) == []
