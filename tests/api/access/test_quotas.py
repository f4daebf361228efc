"""Quotas of keys over HTTP: set, shown, changed, kept to."""

import pytest
from starlette.testclient import TestClient
from store_checks.examples import deliver, running

from eigenfail.testing.examples import result
from eigenfail.values.access import KeyRequest, Quotas, Scope
from eigenfail_services.access import make_key

FIELDS = {"name": "t", "method": "monte_carlo", "simulator": "point_mass", "episodes": 10}
CAMPAIGNS = "/api/v1/campaigns"


@pytest.fixture
def http(app):
    with TestClient(app, base_url="http://127.0.0.1:8440") as client:
        yield client


@pytest.fixture
def admin(keys, show):
    return show(keys["admin"].token)


@pytest.fixture
def limited(store, keys, show):
    """The header of a key with quotas; its id is 4."""
    quotas = Quotas(max_open=2, max_episodes=50, max_episodes_per_day=60)
    return show(make_key(store, KeyRequest("ci", Scope.RUNNER, quotas=quotas)).token)


@pytest.mark.fault("quota exceeded, also by concurrent requests")
def test_the_refusal_names_the_quota_and_what_to_do(http, limited):
    for episodes in (10, 40):
        fields = FIELDS | {"episodes": episodes}
        assert http.post(CAMPAIGNS, json=fields, headers=limited).status_code == 201
    refused = http.post(CAMPAIGNS, json=FIELDS, headers=limited)
    assert refused.status_code == 403
    assert refused.headers["content-type"] == "application/problem+json"
    told = refused.json()
    assert told["type"] == "urn:eigenfail:quota-exceeded"
    assert told["detail"] == (
        "Key 4 'ci' may have 2 campaigns at once that have not ended (max_open); 2 are used, and "
        "this asks for 1."
    )
    assert "`eigenfail key limit 4 --max-open N`" in told["remedy"]


@pytest.mark.fault("quota exceeded, also by concurrent requests")
@pytest.mark.parametrize(
    ("address", "body", "quota"),
    [
        (CAMPAIGNS, FIELDS | {"episodes": 51}, "max_episodes"),
        (f"{CAMPAIGNS}/bulk", [FIELDS] * 3, "max_open"),
        (f"{CAMPAIGNS}/1/clone", {"episodes": 50}, "max_episodes_per_day"),
    ],
)
def test_every_way_to_a_campaign_is_counted(http, limited, address, body, quota):
    spent = FIELDS | {"episodes": 20}
    assert http.post(CAMPAIGNS, json=spent, headers=limited).status_code == 201
    refused = http.post(address, json=body, headers=limited)
    assert refused.status_code == 403
    assert f"({quota})" in refused.json()["detail"]
    assert len(http.get(CAMPAIGNS, headers=limited).json()["items"]) == 1


def test_others_are_not_bounded_by_it(http, admin, limited):
    for _ in range(3):
        assert http.post(CAMPAIGNS, json=FIELDS, headers=admin).status_code == 201


def test_an_administrator_sets_changes_and_sees_them(http, admin):
    wanted = {"name": "ci", "scope": "runner", "quotas": {"max_open": 1}}
    made = http.post("/api/v1/keys", json=wanted, headers=admin).json()
    number, runner = made["key"]["id"], {"Authorization": f"Bearer {made['token']}"}
    assert made["key"]["quotas"]["max_open"] == 1
    assert http.post(CAMPAIGNS, json=FIELDS, headers=runner).status_code == 201
    assert http.post(CAMPAIGNS, json=FIELDS, headers=runner).status_code == 403
    there = f"/api/v1/keys/{number}"
    changed = http.post(f"{there}/quotas", json={"max_open": 2}, headers=admin)
    assert changed.json()["quotas"]["max_open"] == 2
    assert http.post(CAMPAIGNS, json=FIELDS, headers=runner).status_code == 201
    used = http.get(f"{there}/usage", headers=admin).json()
    assert used == {"open": 2, "episodes_of_day": 20}
    page = http.get("/keys", headers=admin | {"Accept": "text/html"}).text
    assert "2 of 2 campaigns open" in page


@pytest.mark.fault("quota exceeded, also by concurrent requests")
def test_nobody_else_changes_or_sees_them(http, limited):
    there = "/api/v1/keys/4"
    lifted = http.post(f"{there}/quotas", json={}, headers=limited)
    assert (lifted.status_code, lifted.json()["type"]) == (403, "urn:eigenfail:forbidden")
    assert http.get(f"{there}/usage", headers=limited).status_code == 403


@pytest.mark.parametrize("quotas", [{"max_open": -1}, {"max_open": 1.5}, {"max": 1}])
def test_what_is_no_quota_is_refused(http, admin, quotas):
    assert http.post("/api/v1/keys/1/quotas", json=quotas, headers=admin).status_code == 422
    assert http.post("/api/v1/keys/99/quotas", json={}, headers=admin).status_code == 404
    assert http.get("/api/v1/keys/99/usage", headers=admin).status_code == 404


def test_a_replay_is_a_campaign_too(http, store, keys, show):
    deliver(store, running(store, simulator="point_mass"), result(0))
    poor = make_key(store, KeyRequest("poor", Scope.RUNNER, quotas=Quotas(max_open=0)))
    there = f"{CAMPAIGNS}/1/episodes/0/replay"
    refused = http.post(there, json={}, headers=show(poor.token))
    assert (refused.status_code, refused.json()["type"]) == (403, "urn:eigenfail:quota-exceeded")
    assert http.post(there, json={}, headers=show(keys["runner"].token)).status_code == 201
