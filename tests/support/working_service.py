"""A service without processes or a socket, for tests of commands."""

import httpx2
from campaigns_here import run_here
from starlette.testclient import TestClient
from typer.testing import CliRunner

from eigenfail import plugins
from eigenfail.cli.connection import Environment
from eigenfail.cli.main import app
from eigenfail.client import Client
from eigenfail.values.episode import EpisodeTask, PriorSource, TrajectorySource, episode_seed
from eigenfail.values.records import Delivery
from eigenfail.wire.http import encode
from eigenfail_api.app import create_app
from eigenfail_api.settings import ApiSettings
from eigenfail_services.campaigns.analysis_jobs import run_analysis
from eigenfail_services.campaigns.references import learner_context
from eigenfail_workers.planners.idm import IntelligentDriver


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
        if (campaign.state, campaign.spec.method) == ("queued", "nearest"):
            run_here(self.store, campaign.id)  # its episodes depend on those before
        elif campaign.state in moves:
            self.store.campaigns.move(campaign.id, moves[campaign.state])
        elif campaign.state == "running":
            self.run_some(campaign)

    def run_some(self, campaign):
        first = campaign.counts.planned - campaign.counts.open
        last = min(first + self.episodes_at_once, campaign.spec.episodes)
        tasks = [self.task(campaign, index) for index in range(first, last)]
        results = [Delivery(result, "by hand") for result in run_tasks(campaign.spec, tasks)]
        self.store.episodes.commit(campaign.id, results)
        self.store.campaigns.add_active(campaign.id, 0.5)
        if last == campaign.spec.episodes:
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


remembered = {}


def run_tasks(spec, tasks):
    """Results of episodes; those of the world of most tests are the same each time, and kept."""
    setup = spec.setup()
    engine = plugins.load(plugins.ENGINES, "default")(setup)
    if (spec.planner, spec.simulator) != ("idm", "point_mass"):
        return list(engine.run(tasks))
    # A test may put another planner's code in place.
    key = (IntelligentDriver.act, encode(setup), encode(tasks))
    if key not in remembered:
        remembered[key] = list(engine.run(tasks))
    return remembered[key]


def run_command(service, *words):
    """Run a command against a service; its result has exit_code, stdout and stderr."""
    surroundings = Environment(connect=lambda url: Client(url, service))
    given = [str(word) for word in words]
    return CliRunner().invoke(app, given, obj=surroundings, prog_name="eigenfail")
