"""How far the chains of a campaign have mixed, for a method that says so, over HTTP."""

import numpy as np
import pytest
from accepted import accept_spec
from msgspec.structs import replace
from starlette.testclient import TestClient

from eigenfail import plugins
from eigenfail.client import Client
from eigenfail.errors import Conflict, NotFound
from eigenfail.values.estimates import ChainMixing, ProjectionMixing
from eigenfail.values.learning import LearnerContext
from eigenfail_services.campaigns.rounds import Rounds
from eigenfail_services.methods.monte_carlo import MonteCarlo

MIXED = ChainMixing(
    campaign=1,
    chains=4,
    started=4,
    moves=40,
    accepted=13,
    first_sample=40,
    draws=10,
    projections=(ProjectionMixing("severity", 1.01, 123.0),),
    mixed=True,
    verdict="Mixed.",
    remark="Shares are those of the starts.",
)


class Chains(MonteCarlo):
    """A method that says whether its chains have started."""

    started = False

    @classmethod
    def judge_mixing(cls, campaign, state):
        assert state == make_learner().state()
        return replace(MIXED, campaign=campaign.id) if cls.started else None


def make_learner():
    nothing = np.zeros((0, 20, 2), np.float32)
    return Chains(LearnerContext(1, 10, 20, nothing), Chains.Settings())


@pytest.fixture
def client(app):
    return Client("http://127.0.0.1:8440", TestClient(app)._transport)


def test_a_method_judges_the_chains_of_its_campaigns(client, store, fields, monkeypatch):
    campaign = client.campaigns.create(**fields).id
    monkeypatch.setattr(plugins, "load", lambda group, name: Chains)
    with pytest.raises(Conflict, match=f"No chain of campaign {campaign} has started"):
        client.campaigns.mixing(campaign)
    store.checkpoints.save(campaign, Rounds(make_learner(), 0, 10).checkpoint())
    with pytest.raises(Conflict, match=f"No chain of campaign {campaign} has started"):
        client.campaigns.mixing(campaign)
    monkeypatch.setattr(Chains, "started", True)
    assert client.campaigns.mixing(campaign) == replace(MIXED, campaign=campaign)


def test_campaigns_without_chains_are_refused(client, store, fields):
    other = client.campaigns.create(**fields)
    with pytest.raises(Conflict, match="which has no chains"):
        client.campaigns.mixing(other.id)
    gone = store.campaigns.create(accept_spec(replace(other.spec, method="no_such_method"))).id
    with pytest.raises(Conflict, match="one of no_such_method, which is not installed here"):
        client.campaigns.mixing(gone)
    with pytest.raises(NotFound):
        client.campaigns.mixing(99)
