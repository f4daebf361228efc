"""What each scope opens: every route has one, and no more than it."""

import asyncio

import pytest

from eigenfail.values.access import Scope
from eigenfail_api.access.scopes import NEEDED, OPEN, changes, needed

LINES = {line: scope for scope, lines in NEEDED.items() for line in lines}


def routes(app):
    """Every method and address of the app, those of routers inside of it, too."""
    for each in app.routes:
        inner = getattr(each, "original_router", None)
        for route in inner.routes if inner else [each]:
            for method in getattr(route, "methods", None) or ():
                yield method, route.path_format


def test_every_route_has_a_scope(app):
    found = {f"{method} {path}" for method, path in routes(app)}
    assert len(found) > 60
    sent = {line for line in found if line.split()[0] not in {"GET", "HEAD"}}
    assert sent - set(LINES) - set(OPEN) == set(), "Say in access/scopes.py what they need."


def test_the_table_names_no_route_that_there_is_not(app):
    found = {f"{method} {path}" for method, path in routes(app)}
    assert set(LINES) | set(OPEN) - {"GET /static/{file:path}"} <= found


def filled(path):
    return path.replace("{campaign}", "1").replace("{index}", "0").replace("{analysis}", "1")


@pytest.mark.parametrize("scope", Scope)
def test_a_scope_opens_what_it_says_and_no_more(app, as_holder, scope):
    for method, template in routes(app):
        path = filled(template).replace("{key}", "999").replace("{name}", "x")
        least = needed(method, path)
        if "events" in path or least is None:
            continue
        for asked in (path, f"{path}%0A"):
            status = as_holder(scope, method, asked).status_code
            assert (status == 403) is not scope.allows(least), (method, asked, status)
            assert status != 401


def test_without_a_key_nothing_is_opened(app, http, keys):
    for method, template in routes(app):
        path = filled(template)
        if needed(method, path) is not None:
            assert http.request(method, path).status_code == 401, (method, path)


def test_what_is_open_says_nothing(http, keys):
    assert http.get("/healthz").json() == {"status": "ok"}
    assert http.get("/readyz").json() == {"status": "ok"}
    assert http.get("/static/css/tokens.css").status_code == 200
    assert http.get("/metrics").status_code == 401
    assert http.head("/api/v1/campaigns").status_code == 401
    for path in ("/openapi.json", "/nope", "/static", "/healthz/"):
        assert http.get(path).status_code in {401, 404}, path


@pytest.mark.parametrize("path", ["/static/../api/v1/campaigns", "/healthz\n/../api/v1/keys"])
def test_no_way_leads_round_the_door(app, path):
    # As it comes over a socket: clients make such addresses plain before they send them.
    started = []

    async def send(message):
        started.append(message)

    async def receive():
        return {"type": "http.request", "body": b""}

    asked = {"type": "http", "method": "GET", "path": path, "raw_path": path.encode()}
    more = {"query_string": b"", "headers": [(b"host", b"localhost")], "scheme": "http"}
    asyncio.run(app(asked | more | {"http_version": "1.1", "root_path": ""}, receive, send))
    assert started[0]["status"] in {401, 404}


def test_an_address_that_nobody_knows_needs_an_administrator(as_holder):
    assert needed("POST", "/nope") is Scope.ADMIN
    assert needed("PUT", "/api/v1/campaigns/1") is Scope.ADMIN
    assert needed("HEAD", "/api/v1/keys") is Scope.ADMIN
    assert as_holder("runner", "PUT", "/api/v1/campaigns/1").status_code == 403


def test_the_missing_scope_is_named(as_holder, problem, fields):
    told = problem(as_holder("viewer", "POST", "/api/v1/campaigns", json=fields), 403)
    assert told["type"] == "urn:eigenfail:forbidden"
    assert "'runner'" in told["detail"]
    assert as_holder("runner", "POST", "/api/v1/campaigns", json=fields).status_code == 201


def test_what_is_only_read_changes_nothing():
    assert not changes("GET", "/api/v1/keys")
    assert not changes("POST", "/api/v1/campaigns/check")
    assert changes("POST", "/api/v1/campaigns")
    assert changes("DELETE", "/api/v1/keys/3")
