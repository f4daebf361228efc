"""What lists ask of the database does not grow with their length."""

import pytest
from sqlalchemy import Engine, event
from store_checks.examples import deliver, running

from eigenfail.testing.examples import collision, result
from eigenfail_api.access import authentication
from eigenfail_services.store.store import open_store


@pytest.fixture
def store(tmp_path):
    store = open_store(f"sqlite:///{tmp_path / 'a.db'}")
    yield store
    store.close()


@pytest.fixture
def asked():
    """Every statement that any database is sent."""
    seen = []

    def note(_connection, _cursor, statement, *_):
        seen.append(statement)

    event.listen(Engine, "before_cursor_execute", note)
    yield seen
    event.remove(Engine, "before_cursor_execute", note)


@pytest.mark.parametrize(
    ("address", "items"),
    [("/api/v1/campaigns/summaries?limit=100", "items"), ("/api/v1/suites/s", "members")],
)
def test_fifty_campaigns_take_as_many_questions_as_five(
    *, http, store, asked, address, items, monkeypatch
):
    # Whether there are keys is asked now and then, whatever else is asked.
    monkeypatch.setattr(authentication, "KEY_CHECK_MS", 3_600_000)
    http.get(address)
    questions = []
    for count in (5, 45):
        for _ in range(count):
            campaign = running(store, name=f"s: {store.events.last()}")
            deliver(store, campaign, collision(0), result(1))
        asked.clear()
        answer = http.get(address).json()
        questions.append((len(answer[items]), len(asked)))
    assert [length for length, _ in questions] == [5, 50]
    assert questions[0][1] == questions[1][1] > 0
