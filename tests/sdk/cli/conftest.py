"""Two services that cost nothing: stand-ins for its processes, and its API without a socket."""

import json
import re
import shlex
import sys
from contextlib import closing

import httpx2
import pytest
from starlette.testclient import TestClient
from typer.testing import CliRunner

from eigenfail import plugins
from eigenfail.cli.connection import Environment
from eigenfail.cli.main import app
from eigenfail.client import Client
from eigenfail.hosting import service as local_service
from eigenfail.values import EpisodeTask, PriorSource, TrajectorySource, episode_seed
from eigenfail.values.records import Delivery
from eigenfail_api.app import create_app
from eigenfail_api.settings import ApiSettings
from eigenfail_services.campaigns.analysis_jobs import run_analysis
from eigenfail_services.campaigns.learner_context import learner_context
from eigenfail_services.campaigns.rounds import Rounds, run_in_process
from eigenfail_services.store import open_store

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


class WorkingService(httpx2.BaseTransport):
    """The real API over a real store, with no socket; at every request some work gets done."""

    episodes_at_once = 8

    def __init__(self, store):
        self.store = store
        self.api = TestClient(create_app(store, ApiSettings()))._transport

    def handle_request(self, request):
        for campaign in self.store.campaigns.page(100).items:
            self.work_on(campaign)
        for analysis in self.store.analyses.page(100).items:
            self.analyse(analysis)
        return self.api.handle_request(request)

    def work_on(self, campaign):
        moves = {"queued": "running", "pausing": "paused", "cancelling": "cancelled"}
        if campaign.state in moves:
            self.store.campaigns.move(campaign.id, moves[campaign.state])
        elif campaign.state == "running":
            self.run_some(campaign)

    def run_some(self, campaign):
        if campaign.spec.method == "nearest":
            self.run_rounds(campaign)
            return
        first = campaign.counts.planned - campaign.counts.open
        last = min(first + self.episodes_at_once, campaign.spec.episodes)
        engine = plugins.load(plugins.ENGINES, "default")(campaign.spec.setup())
        tasks = [self.task(campaign, index) for index in range(first, last)]
        results = [Delivery(result, "by hand") for result in engine.run(tasks)]
        self.store.episodes.commit(campaign.id, results)
        self.store.campaigns.add_active(campaign.id, 0.5)
        if last == campaign.spec.episodes:
            self.store.campaigns.move(campaign.id, "done")

    def run_rounds(self, campaign):
        """Run a campaign whose episodes depend on those before, at once."""
        spec = campaign.spec
        method = plugins.load(plugins.METHODS, spec.method)
        learner = method(learner_context(campaign, self.store), method.Settings(**spec.settings))
        engine = plugins.load(plugins.ENGINES, "default")(spec.setup())
        rounds = Rounds(learner, spec.seed, spec.episodes)
        results = [Delivery(each, "by hand") for each in run_in_process(rounds, engine)]
        self.store.episodes.commit(campaign.id, results)
        self.store.campaigns.move(campaign.id, "done")

    def task(self, campaign, index):
        spec, source = campaign.spec, PriorSource()
        if spec.method == "replay":
            trajectories = learner_context(campaign, self.store).trajectories
            source = TrajectorySource(trajectories[index])
        return EpisodeTask(index, episode_seed(spec.seed, index), source)

    def analyse(self, analysis):
        if analysis.state != "queued":
            return
        run_analysis(self.store, analysis.id)


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
    surroundings = Environment(connect=lambda url: Client(url, service))

    def run(*words):
        given = [str(word) for word in words]
        return CliRunner().invoke(app, given, obj=surroundings, prog_name="eigenfail")

    return run


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
