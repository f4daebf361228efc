"""What the tests of the plug-in share: a service over a store in memory, and commands for it."""

import sys
from pathlib import Path

import pytest
from msgspec.structs import replace
from starlette.testclient import TestClient
from typer.testing import CliRunner

sys.path.append(str(Path(__file__).parent))

from accepted import accept_spec

from eigenfail import plugins
from eigenfail.cli.connection import Environment
from eigenfail.cli.main import app
from eigenfail.client import Client
from eigenfail.values.analysis import AnalysisSettings
from eigenfail.values.campaign import CampaignState
from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail.values.episode import EpisodeTask, Outcome, PriorSource
from eigenfail.values.records import Delivery
from eigenfail_api.app import create_app
from eigenfail_api.settings import ApiSettings
from eigenfail_services.campaigns.analysis_jobs import run_analysis

EPISODES = 12


@pytest.fixture
def http(store):
    """The API as a browser on this machine sees it."""
    with TestClient(
        create_app(store, ApiSettings(poll_s=0.02)), base_url="http://127.0.0.1:8440"
    ) as client:
        yield client


@pytest.fixture
def eigenfail(http):
    """Runs a command against the service; its result has exit_code, stdout and stderr."""
    surroundings = Environment(connect=lambda url: Client(url, http._transport))

    def run(*words):
        given = [str(word) for word in words]
        return CliRunner().invoke(app, given, obj=surroundings, prog_name="eigenfail")

    return run


@pytest.fixture
def played(store):
    """Runs the episodes of a campaign and stores them, all as collisions: campaign, results."""

    def make(episodes=1, **fields):
        wanted = {"name": "played", "method": "monte_carlo", "planner": "idm"}
        wanted |= {"simulator": "point_mass", "scene_every": 1, "episodes": EPISODES}
        spec = CampaignSpec(**wanted | fields)
        campaign = store.campaigns.create(accept_spec(spec)).id
        store.campaigns.move(campaign, CampaignState.RUNNING)
        engine = plugins.load(plugins.ENGINES, "default")(spec.setup())
        tasks = [EpisodeTask(index, 5 + index, PriorSource()) for index in range(episodes)]
        results = [replace(each, outcome=Outcome.COLLISION) for each in engine.run(tasks)]
        store.episodes.commit(campaign, [Delivery(each, "worker-1") for each in results])
        return campaign, results

    return make


@pytest.fixture
def analysed(store, played):
    """An analysis with two modes, that is done; its id."""
    campaign, _ = played(EPISODES)
    store.campaigns.move(campaign, CampaignState.DONE)
    analysis = store.analyses.create(campaign, AnalysisSettings(clusters=2, bootstrap=0)).id
    run_analysis(store, analysis)
    return analysis
