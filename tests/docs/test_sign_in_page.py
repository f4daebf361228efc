"""Settings and nginx.conf of docs/security.md: no forged header names a user through them."""

import json
import re

import pytest
from starlette.testclient import TestClient

from eigenfail.values.access import KeyRequest, Scope
from eigenfail_api.app import create_app
from eigenfail_api.settings import ApiSettings
from eigenfail_services.access import make_key
from eigenfail_services.store.store import open_store

LOCATION = re.compile(r"location ([^{]+?) \{\n(.*?)\n    \}", re.DOTALL)
DIRECTIVE = re.compile(r'proxy_set_header (\S+) ("[^"]*"|\S+);')
NGINX, SIGNED_IN = "10.0.0.5", {"$user": "ada@example.org", "$groups": "staff,safety"}
FORGED = {
    "X-Forwarded-User": "mallory",
    "X-Forwarded-Groups": "eigenfail-admins",
    "X-Forwarded-For": NGINX,
}
SPELLINGS = {
    "as in the manual": str,
    "small": str.lower,
    "large": str.upper,
    "mixed": str.swapcase,
    "underscores": lambda name: name.replace("-", "_"),
    "one underscore": lambda name: "_".join(name.rsplit("-", 1)),
}
"""Of the names of headers; nginx drops those with underscores, and other proxies do not."""


@pytest.fixture(scope="module")
def page(root):
    text = (root / "docs" / "security.md").read_text()
    return text.partition("\n## Sign-in by a proxy\n")[2].partition("\n## ")[0]


@pytest.fixture
def settings(page, monkeypatch):
    """The settings of the page, as a shell would set them."""
    for name, value in re.findall(r"^(EIGENFAIL_\w+)=(.+)$", page, re.MULTILINE):
        monkeypatch.setenv(name, value.strip("'"))
    return ApiSettings()


@pytest.fixture
def client(settings):
    """Requests that nginx passes on, and a key of a viewer."""
    store = open_store("memory://")
    make_key(store, KeyRequest("ada", Scope.ADMIN))
    token = make_key(store, KeyRequest("ci")).token
    address = "http://eigenfail.example.org"
    with TestClient(create_app(store, settings), address, client=(NGINX, 1)) as client:
        yield client, token
    store.close()


@pytest.fixture(scope="module")
def locations(page):
    """The locations of nginx.conf that lead to the service, in order."""
    file = page.partition("# nginx.conf\n")[2].partition("```")[0]
    found = [body for _, body in LOCATION.findall(file) if "10.0.0.9:8440" in body]
    assert len(found) == file.count("proxy_pass http://10.0.0.9:8440;") == 2
    return found


@pytest.fixture(params=SPELLINGS)
def forged(request):
    """Headers of a client that would be an administrator, in one spelling or in two."""
    spell = SPELLINGS[request.param]
    return {
        "Host": "eigenfail.example.org",
        **FORGED,
        **{spell(name): FORGED[name] for name in FORGED},
    }


def pass_on(location, headers, variables):
    """The headers that nginx sends: it replaces those that are set, and leaves out empty ones.

    Names in small and large letters are the same; one with underscores is another one.
    """
    known = {"$host": headers["Host"], "$http_host": headers["Host"], "$scheme": "https"}
    known |= {"$remote_addr": "192.0.2.7", **variables}
    directives = [(name, value.strip('"')) for name, value in DIRECTIVE.findall(location)]
    replaced = {name: known.get(value, value) for name, value in directives}
    assert not any(value.startswith("$") for value in replaced.values())
    names = {name.lower() for name in replaced}
    kept = {name: value for name, value in headers.items() if name.lower() not in names}
    return {name: value for name, value in (kept | replaced).items() if value}


def test_the_service_takes_the_settings_of_the_page(settings):
    assert [str(network) for network in settings.sign_in_proxies] == ["10.0.0.5/32"]
    assert settings.sign_in_scopes["eigenfail-admins"] is Scope.ADMIN
    assert settings.require_keys
    assert settings.names == ("eigenfail.example.org",)


def test_the_signed_in_user_is_that_of_the_identity_provider(client, locations, forged):
    http, _ = client
    sent = pass_on(locations[0], forged, SIGNED_IN)
    assert http.get("/api/v1/campaigns", headers=sent).status_code == 200
    assert http.get("/api/v1/keys", headers=sent).status_code == 403
    body = {"name": "n", "method": "monte_carlo", "episodes": 1, "planner": "idm"}
    write = sent | {"Origin": "https://eigenfail.example.org"}
    assert http.post("/api/v1/campaigns", json=body, headers=write).status_code == 201
    foreign = sent | {"Origin": "https://evil.example"}
    assert http.post("/api/v1/campaigns", json=body, headers=foreign).status_code == 403


def test_a_user_without_groups_has_none_of_the_client(client, locations, forged):
    http, _ = client
    sent = pass_on(locations[0], forged, {"$user": "bob@example.org", "$groups": ""})
    assert http.get("/api/v1/campaigns", headers=sent).status_code == 200
    assert http.get("/api/v1/keys", headers=sent).status_code == 403


def test_the_way_of_programs_knows_keys_alone(client, locations, forged):
    http, token = client
    sent = pass_on(locations[1], forged, {})
    assert http.get("/api/v1/campaigns", headers=sent).status_code == 401
    shown = sent | {"Authorization": f"Bearer {token}"}
    assert http.get("/api/v1/campaigns", headers=shown).status_code == 200
    assert http.get("/api/v1/keys", headers=shown).status_code == 403


def test_oauth2_proxy_replaces_the_headers_too(page):
    file = page.partition("# oauth2-proxy.cfg\n")[2].partition("```")[0]
    options = dict(re.findall(r"^(\w+) = (.+)$", file, re.MULTILINE))
    for name in ("pass_user_headers", "skip_auth_strip_headers", "pass_host_header"):
        assert json.loads(options[name]) is True
