"""Two services that cost nothing: stand-ins for its processes, and one without a socket."""

import json
import re
import shlex
import sys
from contextlib import closing
from functools import partial

import pytest
from working_service import WorkingService, run_command

from eigenfail.hosting import service as local_service
from eigenfail_services.store.store import open_store

CONTROLLER = """
import http.server, sys

class Answers(http.server.BaseHTTPRequestHandler):
    def do_GET(self):
        self.send_response(200 if self.path == "/readyz" else 404)
        self.end_headers()

    def log_message(self, *_):
        pass

http.server.HTTPServer(("127.0.0.1", int(sys.argv[1])), Answers).serve_forever()
"""

SERVICES = """
import json, subprocess, sys, time

print("starting", flush=True)
subprocess.Popen([sys.executable, "-c", "import time; time.sleep(600)"], start_new_session=True)
print(json.dumps({"ready": True, "hub": f"tcp://127.0.0.1:{sys.argv[1]}"}), flush=True)
time.sleep(600)
"""


@pytest.fixture
def stand_ins(monkeypatch):
    """The scripts that run instead of controller and services; a test may replace them."""
    scripts = {"controller": CONTROLLER, "services": SERVICES}

    def commands(plan, database, port, hub_port):
        ports = {"controller": port, "services": hub_port}
        return {
            name: [sys.executable, "-c", script, str(ports[name])]
            for name, script in scripts.items()
        }

    monkeypatch.setattr(local_service, "make_commands", commands)
    return scripts


@pytest.fixture(scope="session")
def working_service():
    """The class of a service over a store of one's own."""
    return WorkingService


@pytest.fixture
def empty_store():
    with closing(open_store("memory://")) as store:
        yield store


@pytest.fixture
def store(empty_store):
    """The store of the service."""
    return empty_store


@pytest.fixture
def service(store, monkeypatch):
    monkeypatch.setattr("eigenfail.client.link.sleep", lambda seconds: None)
    return WorkingService(store)


@pytest.fixture
def eigenfail(service):
    """Runs a command against the service; its result has exit_code, stdout and stderr."""
    return partial(run_command, service)


UNDER_WAY = re.compile(
    r"^campaign \d+ \(\w+\) (?:queued|running): .*\n"
    r"|^.*: (?!(\d+) of \1 )\d+ of \d+ campaigns? over.*\n"
    r"|^.*: \d+ s so far\.\n",
    re.MULTILINE,
)
SPEED = re.compile(r", [\d.,]+ episodes/s(?:, \d+:\d\d:\d\d to go)?")
"""What a command says of its progress, which depends on the speed of the machine."""


@pytest.fixture
def check_session(eigenfail, golden):
    """Compares what commands print and their exit codes with a golden file; a mark tells stderr."""

    def check(name, *commands):
        parts = []
        for words in commands:
            done = eigenfail(*words)
            said = SPEED.sub("", UNDER_WAY.sub("", done.stderr))
            parts += [
                f"$ eigenfail {shlex.join(map(str, words))}",
                done.stdout.rstrip("\n"),
                *(f"! {line}" for line in said.splitlines()),
                f"exit code {done.exit_code}\n",
            ]
        golden.check(name, "\n".join(part for part in parts if part))

    return check


@pytest.fixture
def spec_file(tmp_path):
    """A campaign that takes no time and finds failures."""
    file = tmp_path / "quick.toml"
    file.write_text(
        'method = "monte_carlo"\nplanner = "idm"\nsimulator = "point_mass"\n'
        "episodes = 24\nseed = 1\nscene_every = 5\n"
    )
    return file


@pytest.fixture
def done(eigenfail, spec_file):
    """The id of a campaign that is done."""
    run = eigenfail("run", spec_file, "--json")
    assert run.exit_code == 0, run.output
    return json.loads(run.stdout)["campaign"]
