"""The policy of a campaign over HTTP, out of the checkpoint of a learner that was trained."""

import numpy as np
import pytest

from eigenfail import plugins
from eigenfail.settings import read_settings
from eigenfail.values.campaign import CampaignState
from eigenfail.values.episode import learner_seed
from eigenfail.values.learning import LearnerContext, Policy
from eigenfail.wire.http import decode as read
from eigenfail_services.campaigns.rounds import Rounds
from eigenfail_workers.engine import Engine

HORIZON = 100
SETTINGS = {"round_size": 4, "warm_up": 2, "gradient_steps": 1}


@pytest.fixture
def ast(http, fields, store):
    """A campaign of ast that has begun."""
    given = {**fields, "method": "ast", "episodes": 12, "settings": SETTINGS}
    campaign = http.post("/api/v1/campaigns", json=given).json()["id"]
    return store.campaigns.move(campaign, CampaignState.RUNNING)


@pytest.fixture
def rounds(ast):
    """The rounds of a learner of it."""
    kind = plugins.load(plugins.METHODS, "ast")
    nothing = np.zeros((0, HORIZON, 2), np.float32)
    context = LearnerContext(learner_seed(0), ast.spec.episodes, HORIZON, nothing)
    learner = kind(context, read_settings(kind.Settings, ast.spec.settings, "settings"))
    return Rounds(learner, ast.spec.seed, ast.spec.episodes)


def layers(policy):
    return [*policy.hidden, policy.mean, policy.log_std]


def test_the_newest_policy_of_a_trained_learner_is_told_with_its_weights(
    *, http, ast, rounds, store
):
    engine, versions = Engine(ast.spec.setup()), []
    while opened := rounds.open():
        store.checkpoints.save(ast.id, rounds.checkpoint())
        newest = opened[-1].policy
        engine.add_policy(opened[0].policy)
        told = read(http.get(f"/api/v1/campaigns/{ast.id}/policy").content, Policy)
        assert (told.version, told.amplitude, told.hold) == (
            newest.version,
            newest.amplitude,
            newest.hold,
        )
        for found, wanted in zip(layers(told), layers(newest), strict=True):
            assert found.weight.tobytes() == wanted.weight.tobytes()
            assert found.bias.tobytes() == wanted.bias.tobytes()
        versions.append(told)
        rounds.complete([*engine.run(opened[0].tasks)])
    weights = {layer.weight.tobytes() for told in versions for layer in layers(told)[:1]}
    assert len(weights) > 1  # training changed them


def test_before_the_first_checkpoint_there_is_none(http, ast, problem):
    told = problem(http.get(f"/api/v1/campaigns/{ast.id}/policy"), 404)
    assert "has no policy" in told["detail"]
    assert told["remedy"]


def test_a_campaign_that_trains_none_says_so(http, campaign, problem):
    told = problem(http.get(f"/api/v1/campaigns/{campaign}/policy"), 404)
    assert "'monte_carlo'" in told["detail"]
