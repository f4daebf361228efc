"""How little noise a failure needs, over HTTP, to clients and on the command line."""

import html
from functools import partial

import pytest
from campaigns_here import run_here
from starlette.testclient import TestClient
from typer.testing import CliRunner

from eigenfail.cli.connection import Environment
from eigenfail.cli.main import app as commands
from eigenfail.client import Client
from eigenfail.errors import Conflict, InvalidValue, NotFound
from eigenfail.values.episode import Outcome


@pytest.fixture
def client(app):
    return Client("http://127.0.0.1:8440", TestClient(app)._transport)


@pytest.fixture
def finish(store):
    """Runs a campaign here, to its end."""
    return partial(run_here, store)


@pytest.fixture
def crash(client, fields, finish):
    """A failure of a campaign over scenarios: the campaign's id and the episode's index."""
    varied = {"scenario_parameters": {"distance_m": {"uniform": [56.0, 58.0]}}, "episodes": 12}
    campaign = finish(client.campaigns.create(**fields | varied).id)
    failures = client.episodes.list(campaign, outcome=Outcome.COLLISION)
    return campaign, next(iter(failures)).index


def test_a_failure_is_shrunk_in_the_very_scenario_that_it_drew(client, crash, finish):
    shrinking = client.campaigns.shrink(*crash, episodes=400)
    drawn = shrinking.spec.scenario_parameters["distance_m"]
    assert 56.0 <= drawn <= 58.0
    assert shrinking.spec.settings == {"campaign": crash[0], "episode": crash[1]}
    assert shrinking.spec.name.endswith(f"minimal failure of {crash[0]}/{crash[1]}")
    told = client.campaigns.minimal(finish(shrinking.id))
    assert told.done
    assert told.needed < told.injected
    assert client.episodes.get(told.campaign, told.index).is_failure


def test_it_stands_on_the_page_of_its_campaign(app, client, crash, finish):
    number = finish(client.campaigns.shrink(*crash, episodes=40).id)
    transport = TestClient(app)._transport
    surroundings = Environment(connect=lambda url: Client(url, transport))
    shown = CliRunner().invoke(commands, ["campaign", "show", str(number)], obj=surroundings)
    assert shown.exit_code == 0, shown.output
    told = client.campaigns.minimal(number)
    for words in (f"Minimal failure {number}/{told.index}", told.words, told.because):
        assert words in " ".join(shown.stdout.split())


def test_the_dashboard_has_the_minimal_failure_and_leads_to_it(app, client, crash, finish):
    campaign, index = crash
    number = finish(client.campaigns.shrink(*crash, episodes=40).id)
    told = client.campaigns.minimal(number)
    browser = TestClient(app, base_url="http://127.0.0.1:8440")
    shown = browser.get(f"/campaigns/{number}", headers={"Accept": "text/html"}).text
    assert told.words in html.unescape(shown)
    assert f'href="/campaigns/{number}/episodes/{told.index}"' in shown
    assert "Next steps" not in shown
    original = browser.get(f"/campaigns/{campaign}/episodes/{index}").text
    assert f'<a href="/campaigns/{number}">Campaign {number}</a> has shrunk' in original


def test_what_is_no_failure_or_not_there_is_refused(client, crash, finish, fields):
    campaign, _ = crash
    safe = next(iter(client.episodes.list(campaign, outcome=Outcome.SAFE)), None)
    if safe is not None:
        with pytest.raises(InvalidValue, match="not a collision"):
            client.campaigns.shrink(campaign, safe.index)
    with pytest.raises(NotFound):
        client.campaigns.shrink(campaign, 99)
    with pytest.raises(Conflict, match="shrinks no failure"):
        client.campaigns.minimal(campaign)
    waiting = client.campaigns.shrink(*crash)
    with pytest.raises(Conflict, match="no replay of it has failed"):
        client.campaigns.minimal(waiting.id)
