"""No key is to be read anywhere but where it is made: not in answers, logs, lines or files."""

import logging
import sqlite3

import pytest
from starlette.testclient import TestClient

from eigenfail.values.access import KeyRequest, NewKey, Scope, redact
from eigenfail_api.app import create_app
from eigenfail_api.settings import ApiSettings
from eigenfail_services.access import make_key
from eigenfail_services.store.store import open_store

CAMPAIGNS = "/api/v1/campaigns"


@pytest.fixture
def database(tmp_path):
    return tmp_path / "eigenfail.db"


@pytest.fixture
def store(database):
    opened = open_store(f"sqlite:///{database}")
    yield opened
    opened.close()


@pytest.mark.fault(
    "key in an address, a log or an error",
    group="api",
    outcome="No key appears in logs, pages, events or the database; an address with a key is "
    "refused.",
)
def test_a_key_is_nowhere(*, database, store, app, show, caplog, fields, monkeypatch):
    caplog.set_level(logging.DEBUG)
    made = make_key(store, KeyRequest("me", Scope.ADMIN))
    wrong = f"ef_1_{'s' * 43}"
    answers = []
    with TestClient(app, base_url="http://127.0.0.1", raise_server_exceptions=False) as client:
        for token in (made.token, wrong):
            ask = {"headers": show(token)}
            answers += [
                client.get(CAMPAIGNS, **ask),
                client.post(CAMPAIGNS, json=fields, **ask),
                client.get(f"{CAMPAIGNS}?limit={token}", **ask),
                client.get(f"{CAMPAIGNS}?{token}=1", **ask),
                client.get(f"{CAMPAIGNS}/{token}", **ask),
                client.delete(f"/api/v1/keys/{token}", **ask),
                client.get(f"/login?next=/{token.replace('_', '%5F')}"),
                client.get(
                    "/", headers={"Accept": "text/html", "Cookie": f"eigenfail_session={token}"}
                ),
                client.post("/login", data={"key": token, "next": "/suites"}),
                client.post(CAMPAIGNS, content=f'{{"{token}": 1}}', **ask),
            ]
        monkeypatch.setattr(store.campaigns, "page", lambda *_: {}[made.token])
        answers.append(client.get(CAMPAIGNS, headers=show(made.token)))
    assert answers[-1].status_code == 500
    shown = "".join(f"{each.text}{each.headers}" for each in answers)
    # The client of the test logs what it asks for; that is not the service.
    logged = [each.getMessage() for each in caplog.records if each.name != "httpx2"]
    lines = f"{logged}{store.audit.page(1_000)}{store.keys.page(10)}"
    with sqlite3.connect(database) as connection:
        connection.execute("PRAGMA wal_checkpoint(TRUNCATE)")
    connection.close()
    kept = b"".join(path.read_bytes() for path in database.parent.iterdir()).decode("latin-1")
    for token in (made.token, wrong):
        secret = token.removeprefix("ef_1_")
        assert secret not in shown
        assert secret not in lines
        assert secret not in kept


@pytest.mark.fault("key in an address, a log or an error")
@pytest.mark.parametrize("place", ["/api/v1/campaigns?key={}", "/{}", "/api/v1/campaigns/{}"])
def test_a_key_in_an_address_is_refused_also_where_none_is_needed(http, problem, place):
    token = f"ef_1_{'s' * 43}"
    told = problem(http.get(place.format(token)), 422)
    assert "must not be part of a URL" in told["detail"]
    assert token not in str(told)


@pytest.mark.fault("key in an address, a log or an error")
def test_a_fault_with_a_key_in_it_is_logged_without(app, store, keys, show, monkeypatch):
    logged = []
    handler = logging.Handler()
    handler.emit = lambda record: logged.append(logging.Formatter().format(record))
    logger = logging.getLogger("uvicorn.error")
    logger.addHandler(handler)
    token = keys["admin"].token
    try:
        int(token)
    except ValueError:
        logger.exception("with %s", token)
    logger.removeHandler(handler)
    (line,) = logged
    assert "ValueError: invalid literal for int() with base 10: 'ef_1_…'" in line
    assert "with ef_1_…" in line
    assert token not in line


def test_a_new_key_does_not_show_itself(keys):
    made = keys["admin"]
    assert isinstance(made, NewKey)
    assert made.token not in f"{made!r} {made} {made.__rich_repr__()}"
    assert redact(f"a {made.token} b") == "a ef_1_… b"


@pytest.mark.fault("key in an address, a log or an error")
def test_what_is_kept_of_a_secret_is_its_digest(store, keys):
    record = store.keys.find(1)
    assert len(bytes.fromhex(record.digest)) == 32
    assert record.digest not in keys["admin"].token


def test_two_apps_on_one_database_know_the_same_keys(store, keys, show):
    for _ in range(2):
        app = create_app(store, ApiSettings())
        with TestClient(app, base_url="http://127.0.0.1") as client:
            answer = client.get(CAMPAIGNS, headers=show(keys["viewer"].token))
            assert answer.status_code == 200
