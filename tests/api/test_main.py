"""`python -m eigenfail_api`: serves until told to stop, or says in one sentence why it cannot."""

import os
import signal
import socket
import subprocess
import sys
import time

import deadlines
import httpx2
import pytest

from eigenfail.client import Client
from eigenfail_api.__main__ import main

pytestmark = pytest.mark.service


@pytest.fixture
def start(tmp_path):
    """Starts the API on a database of its own; ends what is left at the end."""
    started = []

    def run(*arguments, program=("-m", "eigenfail_api"), **environment):
        process = subprocess.Popen(
            [sys.executable, *program, *arguments],
            env={**os.environ, "EIGENFAIL_DATABASE": f"sqlite:///{tmp_path}/e.db", **environment},
            cwd=tmp_path,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        started.append(process)
        return process

    yield run
    for process in started:
        process.kill()
        process.communicate()


@pytest.fixture
def running(start):
    """A process that serves, and its address."""
    process = start("--port", "0")
    return process, process.stdout.readline().split()[-1]


@pytest.fixture
def refusal(capsys):
    """Exit code and the one line of a start that is refused."""

    def run(*arguments):
        code = main(arguments)
        said = capsys.readouterr()
        assert said.out == ""
        assert said.err.count("\n") == 1, said.err
        return code, said.err

    return run


def test_it_serves_and_remembers(running, fields):
    _, address = running
    with Client(address) as client:
        assert client.health()
        campaign = client.campaigns.create(**fields)
        assert client.campaigns.get(campaign.id) == campaign


@pytest.mark.parametrize(("proxies", "statuses"), [("[]", {200, 429}), ('["127.0.0.1"]', {200})])
def test_only_a_proxy_that_was_named_says_who_asks(start, proxies, statuses):
    limit = {"EIGENFAIL_MAX_KEYLESS_REQUESTS_PER_S": "0.2", "EIGENFAIL_PROXIES": proxies}
    address = start("--port", "0", **limit).stdout.readline().split()[-1]
    with httpx2.Client(base_url=address) as http:
        found = {
            http.get("/api/v1/campaigns", headers={"X-Forwarded-For": f"10.0.0.{n}"}).status_code
            for n in range(5)
        }
    assert found == statuses


@pytest.mark.parametrize(("signs_in", "status"), [("127.0.0.1", 200), ("10.9.0.1", 401)])
def test_only_the_peer_of_a_connection_can_name_a_user(start, signs_in, status):
    """The address in X-Forwarded-For is believed for limits and logs, and never for this."""
    named = {
        "EIGENFAIL_SIGN_IN_PROXIES": f'["{signs_in}"]',
        "EIGENFAIL_SIGN_IN_SCOPES": '{"*": "viewer"}',
        "EIGENFAIL_PROXIES": '["127.0.0.1"]',
    }
    address = start("--port", "0", **named).stdout.readline().split()[-1]
    headers = {"X-Forwarded-User": "ada", "X-Forwarded-For": "10.9.0.1"}
    assert httpx2.get(f"{address}/api/v1/campaigns", headers=headers).status_code == status


@pytest.mark.parametrize("stop", [signal.SIGINT, signal.SIGTERM])
def test_it_stops_when_told_to_with_a_follower_listening(running, stop):
    process, address = running
    with httpx2.stream("GET", f"{address}/api/v1/events", timeout=deadlines.PROCESS_S) as response:
        parts = response.iter_text()
        next(parts)
        began = time.monotonic()
        process.send_signal(stop)
        for _ in parts:
            pass
        process.wait(timeout=deadlines.PROCESS_S)
    assert time.monotonic() - began < 4.0
    assert process.returncode == 0
    assert "Traceback" not in process.stderr.read()


WITH_WORK_ASIDE = """
import runpy, time
from eigenfail_api.routes.episodes import EXPLAINING
EXPLAINING._pool.submit(time.sleep, 60.0)
runpy.run_module("eigenfail_api", run_name="__main__", alter_sys=True)
"""


def test_it_does_not_wait_for_work_aside_when_told_to_stop(start):
    process = start("--port", "0", program=("-c", WITH_WORK_ASIDE))
    assert process.stdout.readline().startswith("eigenfail API on")
    process.send_signal(signal.SIGTERM)
    assert process.wait(timeout=50) == 0


WITH_A_SIGNAL_IN_A_CALLBACK = """
import os, signal, sys, time, weakref
from eigenfail_api import __main__ as program

say = program.announce

def announce(*where):
    say(*where)
    thing = lambda: None
    reference = weakref.ref(thing, lambda _: (os.kill(os.getpid(), signal.SIGTERM), time.sleep(0)))
    del thing

program.announce = announce
sys.exit(program.main(sys.argv[1:]))
"""


def test_a_signal_that_comes_before_the_start_is_not_lost(start):
    """It comes while the garbage collector calls back, where an exception would be ignored."""
    process = start("--port", "0", program=("-c", WITH_A_SIGNAL_IN_A_CALLBACK))
    assert process.stdout.readline().startswith("eigenfail API on")
    assert process.wait(timeout=deadlines.PROCESS_S) == 0


@pytest.mark.fault(
    "port already in use",
    group="processes",
    outcome="One sentence names the port before anything starts; exit code 3.",
)
def test_a_taken_port_is_one_sentence(refusal):
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        code, line = refusal("--port", str(port))
    assert code == 3
    assert f"Port {port} of 127.0.0.1 is taken." in line
    assert "--port" in line


def test_an_open_door_is_one_sentence(refusal):
    code, line = refusal("--host", "0.0.0.0", "--port", "0")
    assert code == 2
    assert "EIGENFAIL_TRUST_NETWORK=1" in line
    assert "EIGENFAIL_HOSTS" in line


@pytest.mark.parametrize(
    ("arguments", "field"),
    [
        (("--port", "70000"), "port"),
        (("--port", "http"), "port"),
        (("--host", "300.0.0.1"), "host"),
    ],
)
def test_wrong_arguments_are_one_sentence(refusal, monkeypatch, arguments, field):
    monkeypatch.setenv("EIGENFAIL_TRUST_NETWORK", "1")
    code, line = refusal(*arguments)
    assert code == 2
    assert f"eigenfail: {field}:" in line


@pytest.mark.parametrize(
    ("variable", "value"), [("EIGENFAIL_PORT", "x"), ("EIGENFAIL_HOSTS", "localhost")]
)
def test_wrong_variables_are_one_sentence(refusal, monkeypatch, variable, value):
    monkeypatch.setenv(variable, value)
    code, line = refusal()
    assert code == 2
    assert variable.removeprefix("EIGENFAIL_").lower() in line


def test_a_database_that_cannot_be_is_one_sentence(refusal, tmp_path):
    (tmp_path / "file").write_text("not a folder")
    code, line = refusal("--port", "0", "--database", f"sqlite:///{tmp_path}/file/e.db")
    assert code == 3
    assert "file" in line
