"""An API over a store in memory, asked without a socket."""

import msgspec
import numpy as np
import pytest
from starlette.testclient import TestClient

from eigenfail.values.analysis import AnalysisResult, AnalysisSettings, FailureMode
from eigenfail.values.campaign import CampaignState
from eigenfail.values.disturbance import NoiseTrajectory
from eigenfail.values.episode import EpisodeFault, EpisodeResult, Outcome
from eigenfail.values.measures import Measures
from eigenfail.values.records import Delivery
from eigenfail.values.scene import Scene
from eigenfail_api.app import create_app
from eigenfail_api.settings import ApiSettings

STEPS = 4


@pytest.fixture(autouse=True)
def formats(tiny_formats):
    """Formats of recordings that do not depend on what is installed; a test may change them."""
    return tiny_formats


@pytest.fixture
def app(store):
    return create_app(store, ApiSettings(poll_s=0.02), extensions=())


@pytest.fixture
def http(app):
    """The API as a browser or curl on this machine sees it; faults of its own are answered."""
    with TestClient(app, base_url="http://127.0.0.1:8440", raise_server_exceptions=False) as client:
        yield client


@pytest.fixture
def fields():
    """The least that makes a campaign, with plug-ins that are quick to load."""
    return {
        "name": "first",
        "method": "monte_carlo",
        "episodes": 10,
        "planner": "idm",
        "simulator": "point_mass",
    }


@pytest.fixture
def campaign(http, fields):
    """The id of a campaign."""
    return http.post("/api/v1/campaigns", json=fields).json()["id"]


@pytest.fixture
def result():
    """Makes an episode's result; collisions keep their scene."""

    def make(index, outcome=Outcome.SAFE):
        rng = np.random.default_rng(index)
        z = rng.normal(size=(STEPS, 2)).astype(np.float32)
        collided = outcome is Outcome.COLLISION
        scene = Scene(
            dt_s=0.1,
            vehicles=rng.normal(size=(STEPS + 1, 2, 4)).astype(np.float32),
            sizes=np.full((2, 2), 2.0, np.float32),
            perceived=np.zeros((STEPS, 2), np.float32),
            controls=np.zeros((STEPS, 2), np.float32),
        )
        return EpisodeResult(
            index=index,
            seed=index + 100,
            outcome=outcome,
            steps=STEPS,
            noise=NoiseTrajectory(z, np.ones_like(z)),
            source="prior",
            measures=Measures(0.0 if collided else 3.5, severity=25.0 if collided else None),
            scene=scene if collided else None,
        )

    return make


@pytest.fixture
def failed():
    """Makes the result of an episode that did not get as far as its first step."""

    def make(index):
        nothing = np.zeros((0, 2), np.float32)
        return EpisodeResult(
            index=index,
            seed=index,
            outcome=Outcome.ERRORED,
            steps=0,
            noise=NoiseTrajectory(nothing, nothing),
            source="prior",
            fault=EpisodeFault("planner", "It raised."),
        )

    return make


@pytest.fixture
def deliver(store):
    """Commits results to a campaign that runs."""

    def commit(campaign, *results):
        if store.campaigns.get(campaign).state is CampaignState.QUEUED:
            store.campaigns.move(campaign, CampaignState.RUNNING)
        return store.episodes.commit(campaign, [Delivery(each, "worker-1") for each in results])

    return commit


@pytest.fixture
def finished(store, campaign):
    """Makes an analysis of the campaign, or of another, that is done; its id."""

    def make(modes=2, of=None):
        analysis = store.analyses.create(of or campaign, AnalysisSettings())
        store.analyses.start(analysis.id)
        store.analyses.finish(analysis.id, analysis_result(modes))
        return analysis.id

    return make


def analysis_result(modes):
    noise = np.linspace(-1.0, 1.0, STEPS * 2, dtype=np.float32).reshape(STEPS, 2)
    centre = np.ones(1, np.float32)
    return AnalysisResult(
        episodes=tuple(range(modes)),
        explained=np.ones(1, np.float32),
        components=noise[None],
        scores=np.ones((modes, 1), np.float32),
        labels=tuple(range(modes)),
        modes=tuple(FailureMode(1, n, centre, noise * (n + 1)) for n in range(modes)),
        influence=np.abs(noise),
        silhouette=None,
        noise_silhouette=None,
    )


@pytest.fixture
def read():
    """The values in a response."""

    def decode(response, kind):
        return msgspec.json.decode(response.content, type=kind)

    return decode


@pytest.fixture
def problem():
    """Checks that a response is a problem of a status, and returns it."""

    def check(response, status):
        assert response.status_code == status, response.text
        assert response.headers["content-type"] == "application/problem+json"
        told = response.json()
        assert told["status"] == status
        assert {"type", "title", "detail", "instance"} <= told.keys()
        assert told["detail"]
        assert "Traceback" not in response.text
        return told

    return check
