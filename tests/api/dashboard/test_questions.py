"""A page asks the database as often for many campaigns as for few."""

import re

import pytest
from accepted import accept_spec
from sqlalchemy import event
from sqlalchemy.engine import Engine
from starlette.testclient import TestClient
from store_checks.examples import deliver

from eigenfail.testing.examples import collision, result, spec
from eigenfail.values.analysis import AnalysisSettings
from eigenfail.values.campaign import CampaignState
from eigenfail.values.summary import MOST_SAMPLES
from eigenfail_api.app import create_app
from eigenfail_api.dashboard import campaign_page
from eigenfail_api.settings import ApiSettings
from eigenfail_services.store.store import open_store

SHARED = re.compile(r"BEGIN|SELECT keys\.")
PAGES = (
    *("/", "/campaigns/1", "/campaigns/1/measures", "/campaigns/1/episodes/0", "/analyses/1"),
    *("/campaigns/1/episodes", "/failures", "/failures?planner=idm"),
)


@pytest.fixture
def database(tmp_path):
    """A store in a file."""
    opened = open_store(f"sqlite:///{tmp_path / 'eigenfail.db'}")
    yield opened
    opened.close()


@pytest.fixture
def browse(database, monkeypatch):
    """An application over it, anew each time: nothing is remembered."""
    # Whether a page waits for its later part is a matter of milliseconds, and of more questions.
    monkeypatch.setattr(campaign_page.costs, "is_prefetched", lambda begun: False)

    def client():
        app = create_app(database, ApiSettings())
        return TestClient(app, base_url="http://127.0.0.1:8440")

    return client


def add(store, count, episodes):
    """Campaigns with results of their own."""
    for _ in range(count):
        campaign = store.campaigns.create(accept_spec(spec(episodes=episodes))).id
        running = store.campaigns.move(campaign, CampaignState.RUNNING)
        deliver(store, running, collision(0), *(result(index) for index in range(1, episodes)))


def asked(client, address):
    """The statements that a page costs, beside those that all share: transactions, and keys."""
    statements = []

    def note(_connection, _cursor, statement, *_):
        statements.append(statement)

    event.listen(Engine, "before_cursor_execute", note)
    try:
        assert client.get(address).status_code == 200
    finally:
        event.remove(Engine, "before_cursor_execute", note)
    return [each for each in statements if not SHARED.match(each)]


def test_pages_cost_a_fixed_number_of_questions(database, browse):
    add(database, 5, 3)
    database.analyses.create(1, AnalysisSettings())
    with browse() as client:
        few = {page: len(asked(client, page)) for page in PAGES}
    add(database, 195, 3)
    with browse() as client:
        many = {page: len(asked(client, page)) for page in PAGES}
    assert all(many[page] <= few[page] for page in PAGES), (few, many)
    assert max(many.values()) <= 20


def test_more_episodes_cost_no_more_questions(database, browse):
    add(database, 2, 3)
    add(database, 1, 400)
    with browse() as client:
        for page in ("/campaigns/{}", "/campaigns/{}/measures"):
            few, many = (len(asked(client, page.format(campaign))) for campaign in (1, 3))
            assert many == few


def test_what_has_not_changed_is_not_read_again(database, browse):
    add(database, 1, 9)
    with browse() as client:
        asked(client, "/campaigns/1")
        again = asked(client, "/campaigns/1")
    # What is left reads a campaign's row, or a page of a list.
    whole = [each for each in again if re.search(r"FROM .*episodes", each) and "LIMIT" not in each]
    assert [each for each in whole if " IN " not in each] == []


COUNT = re.compile(r"SELECT campaigns\.id, campaigns\.completed \+ campaigns\.failed")


def test_the_pages_of_a_campaign_take_its_number_of_results_from_its_row(database, browse):
    add(database, 1, 3)
    with browse() as client:
        for page in ("/campaigns/1", "/campaigns/1/measures"):
            assert not [each for each in asked(client, page) if COUNT.match(each)]
        assert [each for each in asked(client, "/") if COUNT.match(each)]


def test_answers_as_of_a_campaign_are_of_its_results_when_it_was_read(database):
    first, second = (database.campaigns.create(accept_spec(spec(episodes=3))).id for _ in range(2))

    def totals(campaign):
        return database.figures.totals([campaign])[campaign]

    for each in (first, second):
        deliver(database, database.campaigns.move(each, CampaignState.RUNNING), collision(0))
    read = database.campaigns.get(first)
    assert [totals(each).failures for each in (first, second)] == [1, 1]
    for each in (first, second):
        deliver(database, database.campaigns.get(each), collision(1))
    with database.figures.as_of(read):
        assert [totals(each).failures for each in (first, second)] == [1, 2]
    with database.figures.as_of(database.campaigns.get(first)):
        assert totals(first).failures == 2
    assert totals(first).failures == 2


def test_a_chart_has_at_most_two_thousand_points(store, http, monkeypatch):
    asked_for = []
    samples = store.figures.samples

    def few(campaign, most=MOST_SAMPLES):
        asked_for.append(most)
        return samples(campaign, 4)

    monkeypatch.setattr(store.figures, "samples", few)
    add(store, 1, 10)
    text = http.get("/campaigns/1").text
    assert asked_for == [2_000]
    assert "A sample of 4 of 10." in text
