"""The API held against its own OpenAPI document, with requests that schemathesis makes up."""

import json
from pathlib import Path

import deadlines
import numpy as np
import pytest
import schemathesis
from accepted import accept_spec
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st
from schemathesis.generation import GenerationMode

from eigenfail.values.access import KeyRequest, Scope
from eigenfail.values.analysis import AnalysisResult, AnalysisSettings, FailureMode
from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail.values.disturbance import NoiseTrajectory
from eigenfail.values.episode import EpisodeResult, Outcome
from eigenfail.values.measures import Measures
from eigenfail.values.records import Delivery
from eigenfail_api.app import create_app
from eigenfail_api.settings import ApiSettings
from eigenfail_services.access import make_key
from eigenfail_services.store.store import open_store

STEPS, EPISODES = 12, 20
EXAMPLES = {GenerationMode.POSITIVE: 5, GenerationMode.NEGATIVE: 3}
PATIENCE_S = deadlines.PROCESS_S
DOCUMENT = json.loads((Path(__file__).parents[2] / "api" / "openapi.json").read_text())
# A stream has no end that a test could wait for.
OPERATIONS = {
    (path, verb): told
    for path, item in DOCUMENT["paths"].items()
    for verb, told in item.items()
    if path != "/api/v1/events"
}


def declared(told):
    """What a request has that can be wrong; every route refuses it at the same place."""
    return json.dumps([told.get("parameters"), told.get("requestBody")], sort_keys=True)


# Of routes that declare the same, one is sent what is wrong; what is right is sent to each.
WRONG = {declared(told): route for route, told in reversed(OPERATIONS.items())}
NOTHING = declared({})
ASKED = [
    *((*route, GenerationMode.POSITIVE) for route in OPERATIONS),
    *((*route, GenerationMode.NEGATIVE) for what, route in WRONG.items() if what != NOTHING),
]
ID, IDS = 1, {"campaign", "analysis", "index"}
# What can be sent may still be refused: for a name that is not known, or an id that is not there.
LEFT_OUT = [schemathesis.checks.positive_data_acceptance]


def result_of(index):
    """Every second episode collides."""
    z = np.random.default_rng(index).normal(size=(STEPS, 2)).astype(np.float32)
    collided = bool(index % 2)
    return EpisodeResult(
        index=index,
        seed=index,
        outcome=Outcome.COLLISION if collided else Outcome.SAFE,
        steps=STEPS,
        noise=NoiseTrajectory(z, np.ones_like(z)),
        source="prior",
        measures=Measures(0.0 if collided else 2.0, severity=9.0 + index if collided else None),
    )


def one_mode():
    """What an analysis found: all failures are alike."""
    noise = np.linspace(-1.0, 1.0, STEPS * 2, dtype=np.float32).reshape(STEPS, 2)
    episodes = tuple(range(1, EPISODES, 2))
    return AnalysisResult(
        episodes=episodes,
        explained=np.ones(1, np.float32),
        components=noise[None],
        scores=np.ones((len(episodes), 1), np.float32),
        labels=tuple(0 for _ in episodes),
        modes=(FailureMode(len(episodes), episodes[0], np.ones(1, np.float32), noise),),
        influence=np.abs(noise),
        silhouette=None,
        noise_silhouette=None,
    )


def fill(store):
    """Campaign 1 with failures and analysis 1 of them; campaign 2, which waits."""
    plain = {"method": "monte_carlo", "planner": "idm", "simulator": "point_mass"}
    campaign = store.campaigns.create(
        accept_spec(CampaignSpec(name="full", episodes=EPISODES, **plain))
    ).id
    store.campaigns.move(campaign, "running")
    store.episodes.commit(campaign, [Delivery(result_of(i), "w") for i in range(EPISODES)])
    store.campaigns.add_active(campaign, 2.0)
    analysis = store.analyses.create(campaign, AnalysisSettings(clusters=1)).id
    store.analyses.start(analysis)
    store.analyses.finish(analysis, one_mode())
    store.campaigns.create(accept_spec(CampaignSpec(name="empty", episodes=5, **plain)))


@pytest.fixture(scope="module")
def service(tmp_path_factory):
    """The API by its document, and who makes keys for it."""
    store = open_store("memory://")
    fill(store)
    database = f"sqlite:///{tmp_path_factory.mktemp('schema')}/eigenfail.db"
    app = create_app(store, ApiSettings(hosts=("testserver",), database=database))
    request = KeyRequest("tester", Scope.ADMIN)
    yield (
        schemathesis.openapi.from_asgi("/openapi.json", app),
        lambda: make_key(store, request).token,
    )
    store.close()


@pytest.mark.fault("unknown field or parameter, or value out of bounds")
@pytest.mark.parametrize(("path", "verb", "mode"), ASKED)
def test_every_route_does_what_its_document_says(service, path, verb, mode):
    schema, administrator = service
    operation = schema[path][verb]

    @settings(
        max_examples=EXAMPLES[mode],
        deadline=None,
        derandomize=True,
        database=None,
        phases=[Phase.explicit, Phase.generate],
        suppress_health_check=list(HealthCheck),
    )
    @given(case=operation.as_strategy(generation_mode=mode), there=st.booleans())
    def attempt(case, there):
        if there:
            case.path_parameters.update({name: ID for name in case.path_parameters if name in IDS})
        # A key for each attempt, since keys are made and revoked here, too.
        shown = {"Authorization": f"Bearer {administrator()}"}
        case.call_and_validate(excluded_checks=LEFT_OUT, timeout=PATIENCE_S, headers=shown)

    attempt()
