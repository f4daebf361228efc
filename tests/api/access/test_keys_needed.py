"""Who is let in: nobody needs a key until there is one; then everybody does, and a valid one."""

from functools import partial

import pytest
from starlette.testclient import TestClient

from eigenfail.errors import InvalidValue
from eigenfail.values.access import KeyRequest, Scope
from eigenfail_api.access.authentication import Authenticator
from eigenfail_api.access.throttling import (
    MOST_NETWORKS,
    LoginThrottle,
    network_of,
)
from eigenfail_api.app import create_app
from eigenfail_api.settings import ApiSettings
from eigenfail_services.access import DatabaseKeys, make_key
from eigenfail_services.store.store import open_store

CAMPAIGNS = "/api/v1/campaigns"
ADMIN = {"name": "first", "scope": "admin"}


def test_nobody_needs_a_key_where_there_is_none(http, show):
    assert http.get(CAMPAIGNS).status_code == 200
    assert http.get(CAMPAIGNS, headers=show("nonsense")).status_code == 200
    assert http.get("/api/v1/keys").json()["items"] == []


@pytest.mark.fault("missing, wrong, expired or insufficient API key")
def test_the_first_key_locks_the_door_at_once(http, show):
    made = http.post("/api/v1/keys", json=ADMIN)
    assert made.status_code == 201
    assert made.headers["cache-control"] == "no-store"
    assert made.headers["location"] == "/api/v1/keys/1"
    assert http.get(CAMPAIGNS).status_code == 401
    assert http.get(CAMPAIGNS, headers=show(made.json()["token"])).status_code == 200


@pytest.mark.fault("missing, wrong, expired or insufficient API key")
def test_a_key_that_was_made_elsewhere_locks_the_door_within_a_second(http, store, clock):
    assert http.get(CAMPAIGNS).status_code == 200
    make_key(store, KeyRequest("me", Scope.ADMIN))
    clock.pass_s(1.0)
    assert http.get(CAMPAIGNS).status_code == 401


def test_without_keys_the_database_is_asked_once_in_a_second(store, clock, monkeypatch):
    authenticator, asked = Authenticator(store, ApiSettings(), clock), []
    exist = store.keys.exist
    monkeypatch.setattr(store.keys, "exist", lambda: asked.append(clock()) or exist())
    for _ in range(5):
        assert not authenticator.requires_keys()
    assert len(asked) == 1
    clock.pass_s(1.0)
    assert not authenticator.requires_keys()
    assert len(asked) == 2


def test_an_answer_from_before_the_first_key_is_not_remembered(store, clock, monkeypatch):
    authenticator, exist = Authenticator(store, ApiSettings(), clock), store.keys.exist

    def answer_late():
        found = exist()
        monkeypatch.setattr(store.keys, "exist", exist)
        make_key(store, KeyRequest("me", Scope.ADMIN))
        authenticator.note_new_key()
        return found

    monkeypatch.setattr(store.keys, "exist", answer_late)
    assert not authenticator.requires_keys()
    assert authenticator.requires_keys()


def test_the_first_key_has_to_be_an_administrators(http, store, problem):
    told = problem(http.post("/api/v1/keys", json={"name": "me", "scope": "runner"}), 422)
    assert (told["field"], store.keys.exist()) == ("scope", False)


def test_keys_can_be_required_before_there_is_one(store):
    app = create_app(store, ApiSettings(require_keys=True))
    with TestClient(app, base_url="http://127.0.0.1") as client:
        assert client.get(CAMPAIGNS).status_code == 401
        assert client.post("/api/v1/keys", json=ADMIN).status_code == 401
        assert client.get("/healthz").status_code == 200


def test_a_revoked_last_key_does_not_open_the_door(http, store, keys):
    for made in keys.values():
        store.keys.revoke(made.key.id)
    assert http.get(CAMPAIGNS).status_code == 401


@pytest.mark.fault(
    "missing, wrong, expired or insufficient API key",
    group="api",
    outcome="It is refused in the same words whatever is wrong with the key; a missing scope "
    "is named.",
)
def test_every_wrong_key_is_refused_in_the_same_words(*, http, keys, store, clock, show, problem):
    token = keys["viewer"].token
    ending = make_key(store, KeyRequest("ends", Scope.ADMIN, 60))
    clock.pass_s(61.0)
    store.keys.revoke(keys["runner"].key.id)
    wrong = {
        "none": {},
        "no token": show(""),
        "not ours": show("x" * 60),
        "another's secret": show(token.replace("ef_3_", "ef_1_")),
        "one letter": show(token[:-1] + ("A" if token[-1] != "A" else "B")),
        "no such key": show(token.replace("ef_3_", "ef_999_")),
        "another scheme": {"Authorization": f"Basic {token}"},
        "expired": show(ending.token),
        "revoked": show(keys["runner"].token),
    }
    answers = {name: http.get(CAMPAIGNS, headers=headers) for name, headers in wrong.items()}
    bodies = {name: problem(answer, 401) for name, answer in answers.items()}
    assert {name for name, body in bodies.items() if body != bodies["none"]} == set()
    assert {answer.headers["www-authenticate"] for answer in answers.values()} == {
        'Bearer realm="eigenfail"'
    }
    assert bodies["none"]["type"] == "urn:eigenfail:unauthorized"
    assert http.get(CAMPAIGNS, headers=show(token)).status_code == 200


@pytest.mark.fault("missing, wrong, expired or insufficient API key")
def test_a_key_ends_to_the_millisecond(http, store, keys, clock, show):
    ending = make_key(store, KeyRequest("ends", Scope.VIEWER, 60))
    left_ms = ending.key.expires_ms - clock.at_ms
    clock.pass_s((left_ms - 1) / 1_000)
    assert http.get(CAMPAIGNS, headers=show(ending.token)).status_code == 200
    clock.pass_s(0.001)
    assert http.get(CAMPAIGNS, headers=show(ending.token)).status_code == 401


def test_when_a_key_was_used_is_written_once_a_minute(as_holder, store, keys, clock):
    def last_used():
        return store.keys.find(keys["viewer"].key.id).key.last_used_ms

    first = clock.at_ms
    for wait_s in (0.0, 59.0):
        clock.pass_s(wait_s)
        assert as_holder("viewer", "GET", CAMPAIGNS).status_code == 200
        assert last_used() == first
    clock.pass_s(1.0)
    as_holder("viewer", "GET", CAMPAIGNS)
    assert last_used() == first + 60_000


@pytest.mark.fault(
    "many wrong API keys",
    group="api",
    outcome="Further attempts have to wait.",
)
def test_too_many_wrong_keys_have_to_wait(http, keys, clock, show, problem):
    right = keys["viewer"].token
    wrong = show(right[:-4] + "AAAA")
    for _ in range(10):
        assert http.get(CAMPAIGNS, headers=wrong).status_code == 401
    refused = http.get(CAMPAIGNS, headers=wrong)
    assert "failed login attempts" in problem(refused, 429)["detail"]
    assert refused.headers["retry-after"] == "60"
    assert http.get(CAMPAIGNS, headers=show(right)).status_code == 200
    assert http.get(CAMPAIGNS, headers=wrong).status_code == 429
    clock.pass_s(60.0)
    assert http.get(CAMPAIGNS, headers=wrong).status_code == 401


@pytest.mark.fault(
    "wrong keys under ever new ids",
    group="api",
    outcome="From the 51st within a minute on they are refused with 429; a valid key still passes.",
)
def test_wrong_keys_are_counted_by_address_too(http, keys, clock, show, problem):
    right = keys["viewer"].token
    statuses = [
        http.get(CAMPAIGNS, headers=show(f"ef_{number}_{'w' * 43}")).status_code
        for number in range(100, 160)
    ]
    assert statuses == [401] * 50 + [429] * 10
    assert http.get(CAMPAIGNS, headers=show(right)).status_code == 200
    clock.pass_s(60.0)
    assert http.get(CAMPAIGNS, headers=show(f"ef_1_{'w' * 43}")).status_code == 401


@pytest.mark.parametrize(
    ("address", "network"),
    [
        ("10.0.0.7", "10.0.0.7"),
        ("::ffff:10.0.0.7", "10.0.0.7"),
        ("2001:db8:1:2:3:4:5:6", "2001:db8:1:2::/64"),
        ("2001:db8:1:2::1", "2001:db8:1:2::/64"),
        ("fe80::1%eth0", "fe80::/64"),
        ("testclient", "testclient"),
        ("", ""),
    ],
)
def test_failures_of_one_network_are_counted_together(address, network):
    assert network_of(address) == network


def test_failures_of_many_addresses_take_bounded_memory():
    attempts = LoginThrottle()
    for number in range(3 * MOST_NETWORKS):
        attempts.count_failure(f"10.{number // 65536}.{number // 256 % 256}.{number % 256}", "1", 0)
    assert len(attempts._by_key) == len(attempts._by_network) == MOST_NETWORKS


@pytest.mark.parametrize("host", ["0.0.0.0", "192.168.0.7"])
def test_other_machines_are_let_in_by_keys_alone(store, host, show):
    with pytest.raises(InvalidValue, match="no administrator has a valid key"):
        create_app(store, ApiSettings(host=host, require_keys=True))
    made = make_key(store, KeyRequest("me", Scope.ADMIN))
    with pytest.raises(InvalidValue, match="authentication is off"):
        create_app(store, ApiSettings(host=host))
    app = create_app(store, ApiSettings(host=host, require_keys=True))
    with TestClient(app, base_url="http://eigenfail.example:8440") as client:
        assert client.get(CAMPAIGNS).status_code == 401
        assert client.get(CAMPAIGNS, headers=show(made.token)).status_code == 200
    store.keys.revoke(made.key.id)
    with pytest.raises(InvalidValue, match="no administrator has a valid key"):
        create_app(store, ApiSettings(host=host, require_keys=True))


def test_keys_are_listed_and_revoked(as_holder, keys, problem):
    listed = as_holder("admin", "GET", "/api/v1/keys?limit=2").json()
    assert [each["name"] for each in listed["items"]] == ["the viewer", "the runner"]
    assert listed["next"] == 2
    assert as_holder("admin", "GET", "/api/v1/keys/1").json()["scope"] == "admin"
    revoked = as_holder("admin", "DELETE", f"/api/v1/keys/{keys['viewer'].key.id}")
    assert revoked.json()["revoked_ms"] > 0
    assert as_holder("viewer", "GET", CAMPAIGNS).status_code == 401
    problem(as_holder("admin", "DELETE", "/api/v1/keys/99"), 404)


@pytest.mark.parametrize(
    ("body", "field"),
    [
        ({"name": ""}, "name"),
        ({"name": " x"}, "name"),
        ({"name": "x" * 101}, "name"),
        ({"name": "x", "scope": "root"}, "scope"),
        ({"name": "x", "expires_s": 0}, "expires_s"),
        ({"name": "x", "expires_s": 10**10}, "expires_s"),
        ({"name": "x", "secret": "mine"}, ""),
        *(({"name": name}, "name") for name in ("loopback", "network", "database", "proxy:ada")),
        *(({"name": name}, "name") for name in ("Network", "PROXY:ada", "pro\u200bxy:ada")),
        ({"name": "\uff50roxy\uff1aada"}, "name"),
    ],
)
def test_what_is_no_key_is_refused_by_name(as_holder, problem, body, field):
    assert (
        problem(as_holder("admin", "POST", "/api/v1/keys", json=body), 422).get("field", "")
        == field
    )


@pytest.mark.parametrize("name", ["networks", "proxy", "proxy of ada", "my loopback"])
def test_names_that_no_other_caller_has_are_free(as_holder, name):
    made = as_holder("admin", "POST", "/api/v1/keys", json={"name": name})
    assert made.json()["key"]["name"] == name


def test_a_database_itself_takes_no_name_of_other_callers(tmp_path):
    database = f"sqlite:///{tmp_path / 'a.db'}"
    open_store(database).close()
    keys = DatabaseKeys(database)
    for make in (
        partial(keys.create, scope="admin"),
        partial(keys.create_first, file=tmp_path / "k"),
    ):
        with pytest.raises(InvalidValue, match="reserved"):
            make("proxy:ada")
    assert not (tmp_path / "k").exists()


def test_the_last_administrator_cannot_be_shut_out(as_holder, store, keys, problem):
    path = f"/api/v1/keys/{keys['admin'].key.id}"
    told = problem(as_holder("admin", "DELETE", path), 409)
    assert "Make another administrator's key first" in told["remedy"]
    assert as_holder("admin", "GET", "/api/v1/keys").status_code == 200
    ends = make_key(store, KeyRequest("ends", Scope.ADMIN, 1))
    store.keys.revoke(ends.key.id)
    problem(as_holder("admin", "DELETE", path), 409)
    make_key(store, KeyRequest("other", Scope.ADMIN))
    assert as_holder("admin", "DELETE", path).status_code == 200
