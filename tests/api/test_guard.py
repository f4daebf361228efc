"""Who may ask: this machine, by its own names, from its own pages."""

import pytest
from starlette.testclient import TestClient

from eigenfail.errors import InvalidValue
from eigenfail.values.access import KeyRequest, Scope
from eigenfail_api.app import create_app
from eigenfail_api.settings import ApiSettings
from eigenfail_services.access import make_key

HEADERS = {
    "content-security-policy": (
        "default-src 'self'; script-src 'self'; style-src 'self'; img-src 'self' data:; "
        "frame-ancestors 'none'; form-action 'self'; base-uri 'none'; object-src 'none'"
    ),
    "cross-origin-opener-policy": "same-origin",
    "cross-origin-resource-policy": "same-origin",
    "x-content-type-options": "nosniff",
    "referrer-policy": "same-origin",
}


@pytest.mark.parametrize(
    "host", ["localhost", "LOCALHOST:8440", "127.0.0.1", "127.0.0.1:99", "[::1]:8440"]
)
def test_names_of_this_machine_are_taken(http, host):
    assert http.get("/healthz", headers={"Host": host}).status_code == 200


@pytest.mark.fault(
    "foreign Host header, or request from another site's page",
    group="api",
    outcome="It is refused, against DNS rebinding and cross-site requests.",
)
@pytest.mark.parametrize(
    "host",
    [
        "evil.example",
        "127.0.0.1.evil.example",
        "localhost.evil.example:8440",
        "evil.example:127.0.0.1",
        "localhost:8440@evil.example",
        "127.0.0.2",
        "testserver",
        "[::1",
        "::1",
        "",
    ],
)
def test_other_names_are_refused_against_dns_rebinding(http, problem, host):
    told = problem(http.get("/healthz", headers={"Host": host}), 400)
    assert told["remedy"]


@pytest.mark.fault("foreign Host header, or request from another site's page")
def test_pages_of_others_cannot_send(http, fields, problem, store):
    for origin in ("https://evil.example", "null", "http://127.0.0.1:3000", "http://["):
        told = problem(http.post("/api/v1/campaigns", json=fields, headers={"Origin": origin}), 403)
        assert origin in told["detail"]
    assert not store.campaigns.page(10).items


def test_our_own_pages_can_send(http, fields):
    origin = {"Origin": "http://127.0.0.1:8440"}
    assert http.post("/api/v1/campaigns", json=fields, headers=origin).status_code == 201


@pytest.mark.parametrize(
    "path", ["/", "/static/js/main.js", "/healthz", "/nope", "/api/v1/campaigns", "/metrics"]
)
def test_every_response_carries_the_security_headers(http, path):
    response = http.get(path)
    assert HEADERS.items() <= dict(response.headers).items()


def test_refusals_and_faults_carry_them_too(http, store, monkeypatch):
    refused = http.get("/healthz", headers={"Host": "evil.example"})
    monkeypatch.setattr(store.campaigns, "page", None)
    fault = http.get("/api/v1/campaigns")
    assert fault.status_code == 500
    for response in (refused, fault):
        assert HEADERS.items() <= dict(response.headers).items()


@pytest.mark.parametrize("host", ["0.0.0.0", "192.168.0.7", "::", "api.example"])
def test_an_open_door_is_refused_while_nobody_has_to_show_a_key(store, host):
    with pytest.raises(InvalidValue, match="authentication is off") as refusal:
        create_app(store, ApiSettings(host=host))
    assert refusal.value.exit_code == 2
    assert "EIGENFAIL_TRUST_NETWORK=1" in refusal.value.remedy


def status(app, method, path, host, origin=None, **request):
    headers = {"Host": host} | ({"Origin": origin} if origin else {})
    with TestClient(app, base_url="http://127.0.0.1:8440") as client:
        return client.request(method, path, headers=headers, **request).status_code


REBOUND = ("evil.example:8440", "http://evil.example:8440")
"""Host and Origin of a page of somebody else's, whose name leads here by now."""

FIRST = {"name": "mine", "scope": "admin"}


@pytest.mark.fault("foreign Host header, or request from another site's page")
def test_on_a_private_network_only_listed_names_are_taken(store, monkeypatch):
    monkeypatch.setenv("EIGENFAIL_TRUST_NETWORK", "1")
    app = create_app(store, ApiSettings(host="0.0.0.0"))
    assert status(app, "GET", "/healthz", "127.0.0.1:8440") == 200
    assert status(app, "GET", "/healthz", "controller:8440") == 400
    assert status(app, "POST", "/api/v1/keys", *REBOUND, json=FIRST) == 400
    assert not store.keys.exist()
    monkeypatch.setenv("EIGENFAIL_HOSTS", '["Controller"]')
    app = create_app(store, ApiSettings(host="0.0.0.0"))
    assert status(app, "GET", "/healthz", "controller:8440") == 200
    assert status(app, "GET", "/healthz", "127.0.0.1:8440") == 400
    assert status(app, "POST", "/api/v1/keys", *REBOUND, json=FIRST) == 400


def test_names_that_are_set_hold_also_where_everybody_shows_a_key(store):
    make_key(store, KeyRequest("me", Scope.ADMIN))
    app = create_app(store, ApiSettings(host="0.0.0.0", require_keys=True, hosts=("lab.example",)))
    assert status(app, "GET", "/healthz", "lab.example") == 200
    assert status(app, "GET", "/healthz", *REBOUND) == 400
    anywhere = create_app(store, ApiSettings(host="0.0.0.0", require_keys=True))
    assert status(anywhere, "GET", "/healthz", "10.1.2.3:8440") == 200
    assert status(anywhere, "GET", "/healthz", "10.1.2.3:8440", "http://evil.example") == 403


@pytest.mark.parametrize("host", ["127.0.0.1", "127.0.0.9", "::1", "localhost"])
def test_loopback_needs_no_vouching(store, host):
    assert create_app(store, ApiSettings(host=host))
