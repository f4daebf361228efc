"""What each scope opens: every route has a least scope, and a weaker key is refused."""

import asyncio
import re
from pathlib import Path

import pytest
from starlette.routing import Mount

from eigenfail.values.access import Scope
from eigenfail_api.access.authentication import is_change, required_scope

REST_PAGE = Path(__file__).parents[3] / "docs" / "rest.md"
NO_KEY = "no key"
HOLDERS = (NO_KEY, "viewer", "runner", "admin")
"""Each may do what the ones before it may."""

STREAM = "/api/v1/events"
"""Its answer does not end by itself."""

# Every route of the app under the least scope that opens it, written by hand: the table in
# access/authentication.py must not be the judge of itself. A new route belongs here as well.
ROUTES = {
    NO_KEY: """
        GET /healthz
        GET /readyz
        GET /login
        POST /login
    """,
    "viewer": """
        GET /
        GET /analyses/{analysis}
        GET /campaigns/{campaign}
        GET /campaigns/{campaign}/episodes
        GET /campaigns/{campaign}/episodes/{index}
        GET /campaigns/{campaign}/episodes/{index}/account
        GET /campaigns/{campaign}/episodes/{index}/clip
        GET /campaigns/{campaign}/failures
        GET /campaigns/{campaign}/measures
        GET /comparison
        GET /copies
        GET /failures
        GET /glossary
        GET /launch
        POST /launch/form
        GET /launch/suite
        POST /launch/suite
        POST /logout
        GET /metrics
        GET /openapi.json
        HEAD /openapi.json
        GET /replays/{campaign}
        GET /releases
        GET /releases/{campaign}
        GET /search
        GET /suites
        GET /suites/{suite}
        GET /workers
        GET /gates
        GET /gates/{gate}
        GET /analyses/{analysis}/modes/{mode}
        GET /analyses/{analysis}/modes/{mode}/history
        GET /analyses/{analysis}/modes/{mode}/overlay
        GET /api/v1/analyses/{analysis}
        GET /api/v1/analyses/{analysis}/modes
        GET /api/v1/analyses/{analysis}/eigenfailures
        GET /api/v1/analyses/{analysis}/modes/{mode}/animation
        GET /api/v1/analyses/{analysis}/modes/{mode}/triage
        GET /api/v1/analyses/{analysis}/proof
        GET /api/v1/campaigns
        POST /api/v1/campaigns/check
        GET /api/v1/campaigns/summaries
        GET /api/v1/campaigns/{campaign}
        GET /api/v1/campaigns/{campaign}/analyses
        GET /api/v1/campaigns/{campaign}/cost
        GET /api/v1/campaigns/{campaign}/course
        GET /api/v1/campaigns/{campaign}/digest
        GET /api/v1/campaigns/{campaign}/episodes
        GET /api/v1/campaigns/{campaign}/episodes.csv
        GET /api/v1/campaigns/{campaign}/episodes.ndjson
        GET /api/v1/campaigns/{campaign}/episodes.parquet
        GET /api/v1/campaigns/{campaign}/episodes/{index}
        GET /api/v1/campaigns/{campaign}/episodes/{index}/explanation
        GET /api/v1/campaigns/{campaign}/episodes/{index}/recording
        GET /api/v1/campaigns/{campaign}/episodes/{index}/steps
        GET /api/v1/campaigns/{campaign}/episodes/{index}/worker
        GET /api/v1/campaigns/{campaign}/minimal
        GET /api/v1/campaigns/{campaign}/mixing
        GET /api/v1/campaigns/{campaign}/policy
        GET /api/v1/campaigns/{campaign}/prunings
        GET /api/v1/campaigns/{campaign}/safety
        GET /api/v1/campaigns/{campaign}/summary
        GET /api/v1/campaigns/{campaign}/workers
        GET /api/v1/comparisons
        GET /api/v1/costs
        GET /api/v1/events
        GET /api/v1/events/list
        GET /api/v1/failures
        GET /api/v1/methods
        GET /api/v1/methods/{name}
        GET /api/v1/planners
        GET /api/v1/planners/{name}
        GET /api/v1/gates
        GET /api/v1/gates/{gate}
        GET /api/v1/releases
        GET /api/v1/releases/{campaign}
        GET /api/v1/scenarios
        GET /api/v1/scenarios/{name}
        GET /api/v1/simulators
        GET /api/v1/simulators/{name}
        GET /api/v1/seeds
        GET /api/v1/suites
        GET /api/v1/suites/{suite}
        GET /api/v1/workers
        GET /api/v1/workers/present
        GET /api/v1/workers/staffing
    """,
    "runner": """
        POST /api/v1/analyses/{analysis}/proof
        PUT /api/v1/analyses/{analysis}/modes/{mode}/name
        POST /api/v1/gates
        POST /api/v1/suites
        POST /analyses/{analysis}/modes/{mode}/triage
        POST /api/v1/analyses/{analysis}/modes/{mode}/triage
        POST /api/v1/campaigns
        POST /api/v1/campaigns/bulk
        POST /api/v1/campaigns/{campaign}/analyses
        POST /api/v1/campaigns/{campaign}/archive
        POST /api/v1/campaigns/{campaign}/restore
        POST /api/v1/campaigns/{campaign}/cancel
        POST /api/v1/campaigns/{campaign}/clone
        POST /api/v1/campaigns/{campaign}/episodes/{index}/replay
        POST /api/v1/campaigns/{campaign}/episodes/{index}/shrink
        POST /api/v1/campaigns/{campaign}/pause
        POST /api/v1/campaigns/{campaign}/priority
        POST /api/v1/campaigns/{campaign}/resume
    """,
    "admin": """
        GET /audit
        GET /keys
        GET /api/v1/audit
        GET /api/v1/keys
        POST /api/v1/keys
        DELETE /api/v1/keys/{key}
        GET /api/v1/keys/{key}
        POST /api/v1/keys/{key}/quotas
        GET /api/v1/keys/{key}/usage
    """,
}
LEAST = {
    line.strip(): scope for scope, lines in ROUTES.items() for line in lines.strip().splitlines()
}
"""The least scope of each method and route."""


def list_routes(app):
    """Return method and address of every route of the app, those of its routers included."""
    found = set()
    for each in app.routes:
        inner = getattr(each, "original_router", None)
        for route in inner.routes if inner else [each]:
            methods = getattr(route, "methods", None) or ()
            found |= {f"{method} {route.path_format}" for method in methods}
    return found


def test_the_hand_written_table_has_every_route_of_the_app_and_no_other(app):
    found = list_routes(app)
    assert not sorted(found - set(LEAST)), "Write into ROUTES which scope these need."
    assert not sorted(set(LEAST) - found), "The app has no such route."
    mounted = [route.path for route in app.routes if isinstance(route, Mount)]
    assert mounted == ["/static"], "Files need a test of their own: see below."


def fill(route):
    """Return method and address of a request; nothing has a number as large as these."""
    method, path = route.split(" ")
    return method, re.sub(r"\{(\w+)\}", lambda m: "x" if m[1] == "name" else "999", path)


def request_start(app, method, path, token):
    """Return the status of an answer whose body is not waited for."""
    started = []

    async def send(message):
        started.append(message)

    incoming = [{"type": "http.request", "body": b""}]

    async def receive():
        return incoming.pop() if incoming else {"type": "http.disconnect"}

    headers = [(b"host", b"127.0.0.1:8440")]
    if token:
        headers.append((b"authorization", f"Bearer {token}".encode()))
    scope = {"type": "http", "method": method, "path": path, "raw_path": path.encode()}
    more = {"query_string": b"", "headers": headers, "scheme": "http"}
    call = app(scope | more | {"http_version": "1.1", "root_path": ""}, receive, send)
    asyncio.run(asyncio.wait_for(call, 20))
    return started[0]["status"]


@pytest.mark.fault("missing, wrong, expired or insufficient API key")
@pytest.mark.parametrize("holder", HOLDERS)
def test_a_request_is_answered_from_its_least_scope_on(app, http, keys, show, holder):
    token = "" if holder == NO_KEY else keys[holder].token
    wrong = {}
    for route, least in LEAST.items():
        method, path = fill(route)
        allowed = HOLDERS.index(holder) >= HOLDERS.index(least)
        # The router takes a line feed behind an address, too.
        for asked in (path, f"{path}%0A"):
            if path == STREAM and (allowed or asked == path):
                status = request_start(app, method, path, token)
            else:
                headers = show(token) if token else {}
                form = {"key": keys["viewer"].token} if route == "POST /login" else None
                answer = http.request(method, asked, headers=headers, data=form)
                status = answer.status_code
                http.cookies.clear()  # A session from /login would stand for a key.
            refusal = 403 if token else 401
            if (status in {401, 403}) if allowed else (status != refusal):
                wrong[f"{method} {asked}"] = status
    assert wrong == {}


def test_the_documents_name_the_least_scope_of_every_route_of_the_api():
    documented = {}
    row = re.compile(r"^\| `(/\S+)` \| [A-Z, ]+ \| ([^|]+) \|", re.MULTILINE)
    for path, scopes in row.findall(REST_PAGE.read_text()):
        for method, scope in (each.split(": ") for each in scopes.split(", ")):
            documented[f"{method} {path}"] = scope
    api = {route for route in LEAST if "/api/v1/" in route}
    assert api <= documented.keys()
    assert documented == {route: LEAST[route] for route in documented}


def test_what_is_open_says_nothing(http, keys):
    assert http.get("/healthz").json() == {"status": "ok"}
    assert http.get("/readyz").json() == {"status": "ok"}
    assert http.get("/static/css/tokens.css").status_code == 200
    assert http.get("/metrics").status_code == 401
    assert http.head("/api/v1/campaigns").status_code == 401
    for path in ("/openapi.json", "/nope", "/static", "/healthz/"):
        assert http.get(path).status_code in {401, 404}, path


@pytest.mark.fault("missing, wrong, expired or insufficient API key")
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
    assert required_scope("POST", "/nope") is Scope.ADMIN
    assert required_scope("PUT", "/api/v1/campaigns/1") is Scope.ADMIN
    assert required_scope("HEAD", "/api/v1/keys") is Scope.ADMIN
    assert as_holder("runner", "PUT", "/api/v1/campaigns/1").status_code == 403


def test_the_missing_scope_is_named(as_holder, problem, fields):
    told = problem(as_holder("viewer", "POST", "/api/v1/campaigns", json=fields), 403)
    assert told["type"] == "urn:eigenfail:forbidden"
    assert "'runner'" in told["detail"]
    assert as_holder("runner", "POST", "/api/v1/campaigns", json=fields).status_code == 201


def test_what_is_only_read_changes_nothing():
    assert not is_change("GET", "/api/v1/keys")
    assert not is_change("POST", "/api/v1/campaigns/check")
    assert is_change("POST", "/api/v1/campaigns")
    assert is_change("DELETE", "/api/v1/keys/3")
