"""A client whose service is in this process: an API over a store in memory, or a script."""

import httpx2
import pytest
from starlette.testclient import TestClient

from eigenfail.client import Client
from eigenfail_api.app import create_app
from eigenfail_api.settings import ApiSettings


@pytest.fixture(autouse=True)
def impatient(monkeypatch):
    """Ask again at once."""
    monkeypatch.setattr("eigenfail.client.link.find_pause", lambda _error, _tried: 0.0)


@pytest.fixture
def client(store):
    """A client of a whole API, without a socket."""
    app = create_app(store, ApiSettings(poll_s=0.02))
    with (
        TestClient(app, raise_server_exceptions=False) as served,
        Client(transport=served._transport) as client,
    ):
        yield client


@pytest.fixture
def scripted():
    """Makes a client whose service answers by a function, and lists what it was asked."""

    def make(answer):
        asked = []

        def handle(request):
            asked.append(request)
            return answer(request, len(asked))

        return Client(transport=httpx2.MockTransport(handle)), asked

    return make


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
