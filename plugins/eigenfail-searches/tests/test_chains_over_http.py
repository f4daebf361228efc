"""How far chains of failures have mixed, over HTTP and on the command line."""

import numpy as np
import pytest
from accepted import accept_spec
from starlette.testclient import TestClient
from typer.testing import CliRunner

from eigenfail.cli.connection import Environment
from eigenfail.cli.main import app as commands
from eigenfail.client import Client
from eigenfail.testing.learner import Corridor, ToyEngine
from eigenfail.values.learning import LearnerContext
from eigenfail_api.app import create_app
from eigenfail_api.settings import ApiSettings
from eigenfail_searches.chains.method import ChainSettings, FailureChains
from eigenfail_services.campaigns.rounds import Rounds, run_in_process

CORRIDOR = Corridor(steps=20, wall=0.5)
SETTINGS = {"campaign": 1, "chains": 4}
FIELDS = {
    "name": "first",
    "method": "monte_carlo",
    "episodes": 10,
    "planner": "idm",
    "simulator": "point_mass",
}


@pytest.fixture
def transport(store):
    return TestClient(create_app(store, ApiSettings(poll_s=0.02), extensions=()))._transport


@pytest.fixture
def client(transport):
    return Client("http://127.0.0.1:8440", transport)


@pytest.fixture
def chains(client, store):
    """A campaign of chains with the checkpoint of one that has run in a corridor."""
    before = client.campaigns.create(**FIELDS)
    spec = {**FIELDS, "method": "chains", "episodes": 80, "settings": SETTINGS}
    # The service creates it only once campaign 1 has ended and has failures.
    made = store.campaigns.create(accept_spec(type(before.spec)(**spec)))
    starts = np.random.default_rng(0).normal(1.5, 0.5, (9, 20, 2)).astype(np.float32)
    learner = FailureChains(LearnerContext(1, 80, 20, starts), ChainSettings(**SETTINGS))
    rounds = Rounds(learner, 0, 80)
    list(run_in_process(rounds, ToyEngine(CORRIDOR)))
    store.checkpoints.save(made.id, rounds.checkpoint())
    return made.id


def test_it_stands_on_the_page_of_its_campaign(client, transport, chains):
    found = client.campaigns.mixing(chains)
    assert (found.chains, found.started, found.moves) == (4, 4, 80 - found.first_sample)
    assert found.projections
    environment = Environment(connect=lambda url: Client(url, transport))
    shown = CliRunner().invoke(commands, ["campaign", "show", str(chains)], obj=environment)
    assert shown.exit_code == 0, shown.output
    words = " ".join(shown.stdout.split())
    for expected in (found.verdict, found.remark, "R-hat", found.projections[0].name):
        assert expected in words
