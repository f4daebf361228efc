"""Whatever is wrong with a request, on whatever route: one shape, one status, the remedy in it."""

import json

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from eigenfail_api.app import ROUTERS

JSON = {"Content-Type": "application/json"}
ROUTES = [
    (method, route.path_format, tuple(sorted(route.param_convertors)))
    for router in ROUTERS
    for route in router.routes
    for method in route.methods
]
WITH_IDS = [route for route in ROUTES if {"campaign", "analysis"} & {*route[2]}]
BODIES = {
    "/api/v1/campaigns/{campaign}/priority": {"priority": "high"},
    "/api/v1/analyses/{analysis}/modes/{mode}/name": {"name": "late braking"},
    "/api/v1/suites": {"name": "a", "base": {}, "grid": {}},
}
"""Where one must be given."""

QUERIES = {"/api/v1/campaigns/{campaign}/episodes/{index}/recording": {"format": "gif"}}
"""Where a parameter must be given."""

NO_IDS = ["x", "-1", "1.5", "1e3", "0x1", str(2**63), "9" * 5000, "%00", "1%20OR%201", "<b>"]
WITH_BODIES = [
    ("POST", "/api/v1/campaigns"),
    ("POST", "/api/v1/campaigns/1/analyses"),
    ("POST", "/api/v1/analyses/1/proof"),
]


def named(route):
    return f"{route[0]} {route[1]}"


@pytest.mark.fault(
    "unknown field or parameter, or value out of bounds",
    group="api",
    outcome="A 4xx that names the field, and the known ones or the bounds.",
)
@pytest.mark.parametrize("route", ROUTES, ids=named)
def test_unknown_parameters_are_refused_with_the_known_ones(http, problem, route):
    method, path, ids = route
    told = problem(http.request(method, path.format(**dict.fromkeys(ids, 1)) + "?limt=3"), 422)
    assert told["type"] == "urn:eigenfail:unknown-name"
    assert (told["field"], told["name"]) == ("query", "limt")


@pytest.mark.parametrize("route", ROUTES, ids=named)
def test_other_verbs_are_refused_with_the_right_ones(http, problem, route):
    _, path, ids = route
    response = http.request("PATCH", path.format(**dict.fromkeys(ids, 1)))
    problem(response, 405)
    assert response.headers["Allow"]


@pytest.mark.fault("unknown field or parameter, or value out of bounds")
@pytest.mark.parametrize("route", WITH_IDS, ids=named)
def test_ids_are_small_positive_numbers(http, problem, route):
    method, path, ids = route
    for id_ in NO_IDS:
        asked = path.format(**dict.fromkeys(ids, id_))
        told = problem(http.request(method, asked, json=BODIES.get(path)), 422)
        assert told["field"] in ids, id_


@pytest.mark.parametrize("route", WITH_IDS, ids=named)
def test_what_is_not_there_is_not_found(http, problem, route):
    method, path, ids = route
    asked = path.format(**dict.fromkeys(ids, 2**63 - 1))
    body, query = BODIES.get(path), QUERIES.get(path)
    told = problem(http.request(method, asked, json=body, params=query), 404)
    assert told["type"] == "urn:eigenfail:not-found"


@pytest.mark.parametrize(
    "path", ["/api/v1", "/nothing/here", "/api/v2/campaigns", "/docs", "/redoc"]
)
def test_other_addresses_are_not_there(http, problem, path):
    told = problem(http.get(path), 404)
    assert path in told["detail"]
    assert "/openapi.json" in told["remedy"]


@pytest.mark.fault(
    "path traversal",
    group="api",
    outcome="A 404; no file outside the service is read.",
)
@pytest.mark.parametrize("path", ["/api/v1/campaigns/../../etc/passwd", "/api/v1/campaigns/%2e%2e"])
def test_tricks_with_paths_lead_nowhere(http, path):
    assert http.get(path).status_code in {404, 422}


@pytest.mark.fault(
    "body that is malformed, deeply nested or too large",
    group="api",
    outcome="A 4xx with the reason; it is not read beyond the limit.",
)
@pytest.mark.parametrize("url", WITH_BODIES, ids=named)
@pytest.mark.parametrize(
    "body",
    [
        b"{",
        b"\xff\xfe",
        b'{"name": "\xff"}',
        b'{"a": NaN}',
        b"name=first",
        b'"\\ud800"',
        b"{}{}",
        b"[" * 500_000,
    ],
    ids=lambda body: repr(body[:12]),
)
def test_what_is_not_json_is_not_read(http, problem, finished, url, body):
    finished()
    response = http.request(*url, content=body, headers=JSON)
    assert response.status_code in {400, 422}
    problem(response, response.status_code)


@pytest.mark.parametrize("url", WITH_BODIES, ids=named)
@pytest.mark.parametrize("body", ["[]", "3", "null", '"text"', "true"])
def test_a_body_is_an_object(http, problem, finished, url, body):
    finished()
    told = problem(http.request(*url, content=body, headers=JSON), 422)
    assert "object" in told["detail"]


@pytest.mark.fault("unknown field or parameter, or value out of bounds")
@pytest.mark.parametrize("url", WITH_BODIES, ids=named)
def test_unknown_fields_are_refused_with_the_known_ones(http, problem, finished, url):
    finished()
    told = problem(http.request(*url, json={"nmae": "typo"}), 422)
    assert told["name"] == "nmae"
    assert told["known"]


@pytest.mark.fault("body that is malformed, deeply nested or too large")
@pytest.mark.parametrize("url", WITH_BODIES, ids=named)
def test_large_bodies_are_refused(http, problem, finished, url):
    finished()
    problem(http.request(*url, content=b" " * 1_000_001, headers=JSON), 413)


def test_the_largest_body_is_still_read(http, fields):
    body = json.dumps(fields).encode().ljust(1_000_000)
    assert http.post("/api/v1/campaigns", content=body, headers=JSON).status_code == 201


@pytest.mark.fault("body that is malformed, deeply nested or too large")
def test_deep_nesting_is_refused(http, problem, fields):
    nested = json.loads('{"a":' * 100 + "1" + "}" * 100)
    problem(http.post("/api/v1/campaigns", json={**fields, "settings": nested}), 422)
    deeper = '{"name":"n","method":"m","episodes":1,"settings":' + '{"a":' * 5000 + "1" + "}" * 5001
    problem(http.post("/api/v1/campaigns", content=deeper, headers=JSON), 400)


@pytest.mark.fault("unknown field or parameter, or value out of bounds")
@pytest.mark.parametrize(
    ("wrong", "field"),
    [
        ({"episodes": 0}, "episodes"),
        ({"episodes": 10**12}, "episodes"),
        ({"episodes": 1.5}, "episodes"),
        ({"episodes": None}, "episodes"),
        ({"episodes": True}, "episodes"),
        ({"seed": -1}, "seed"),
        ({"seed": 2**63}, "seed"),
        ({"name": 3}, "name"),
        ({"name": ""}, "name"),
        ({"method": {}}, "method"),
        ({"stop": []}, "stop"),
        ({"name": "n" * 201}, "name"),
        ({"name": "a\x00b"}, "name"),
        ({"name": "a\nb"}, "name"),
        ({"price_usd_per_hour": -0.01}, "price_usd_per_hour"),
        ({"instances": 0}, "instances"),
        ({"disturbance": {"longitudinal_base_m": 0.0}}, "disturbance.longitudinal_base_m"),
        ({"disturbance": {"scale": 0.0}}, "disturbance.scale"),
        ({"disturbance": {"shape": {}}}, "disturbance.shape.kind"),
        (
            {"disturbance": {"shape": {"kind": "ar1", "lateral_correlation": 1.0}}},
            "disturbance.shape.lateral_correlation",
        ),
        ({"settings": {"round_size": 0}}, "settings.round_size"),
        ({"settings": []}, "settings"),
        ({"scenario_parameters": {"distance_m": 1e9}}, "scenario_parameters.distance_m"),
        ({"planner_settings": {"time_headway_s": "2"}}, "planner_settings.time_headway_s"),
    ],
    ids=str,
)
def test_wrong_values_are_refused_by_their_path(*, http, problem, fields, store, wrong, field):
    told = problem(http.post("/api/v1/campaigns", json=fields | wrong), 422)
    assert told["field"] == field
    assert not store.campaigns.page(10).items


@pytest.mark.fault("unknown field or parameter, or value out of bounds")
def test_a_number_beyond_all_bounds_is_refused_by_its_path(http, problem, fields):
    body = json.dumps(fields).replace("10", "1e999")
    assert problem(http.post("/api/v1/campaigns", content=body), 422)["field"] == "episodes"


@pytest.mark.fault("unknown field or parameter, or value out of bounds")
@pytest.mark.parametrize("missing", ["name", "method", "episodes"])
def test_missing_values_are_named(http, problem, fields, missing):
    del fields[missing]
    assert problem(http.post("/api/v1/campaigns", json=fields), 422)["field"] == missing


@pytest.mark.fault("unknown field or parameter, or value out of bounds")
@pytest.mark.parametrize(
    ("wrong", "field", "known"),
    [
        ({"method": "monte_karlo"}, "method", "monte_carlo"),
        ({"planner": "rulebok"}, "planner", "rulebook"),
        ({"scenario": "cutin"}, "scenario", "cut_in"),
        ({"simulator": "highwy"}, "simulator", "highway"),
        ({"settings": {"rounds": 3}}, "settings", "round_size"),
        ({"scenario_parameters": {"distance": 3}}, "scenario_parameters", "distance_m"),
        ({"planner_settings": {"headway": 3}}, "planner_settings", "time_headway_s"),
        ({"disturbance": {"slope": 3}}, "disturbance", "lateral_slope"),
        ({"disturbance": {"shape": {"kind": "pink"}}}, "disturbance.shape.kind", "student_t"),
        (
            {"disturbance": {"shape": {"kind": "ar1", "nu": 3}}},
            "disturbance.shape",
            "lateral_correlation",
        ),
        ({"method": "os:system"}, "method", "ast"),
    ],
    ids=str,
)
def test_unknown_names_are_refused_with_the_known_ones(
    *, http, problem, fields, wrong, field, known
):
    told = problem(http.post("/api/v1/campaigns", json=fields | wrong), 422)
    assert told["type"] == "urn:eigenfail:unknown-name"
    assert told["field"] == field
    assert known in told["known"]
    assert known in told["remedy"]


@pytest.mark.parametrize("what", ["analysis", "campaign"])
def test_a_replay_of_what_is_not_there_is_refused(http, problem, fields, what):
    wrong = {"method": "replay", "settings": {what: 99}}
    assert problem(http.post("/api/v1/campaigns", json=fields | wrong), 422)["field"] == (
        f"settings.{what}"
    )


@pytest.mark.parametrize("method", ["minimal", "replay"])
def test_a_campaign_without_noise_to_inject_is_refused(http, problem, fields, method):
    wrong = {"method": method, "settings": {}}
    told = problem(http.post("/api/v1/campaigns", json=fields | wrong), 422)
    assert told["field"] == "settings"
    assert told["remedy"]


@pytest.mark.fault("unknown field or parameter, or value out of bounds")
@pytest.mark.parametrize(
    "query", ["limit=0", "limit=1001", "limit=x", "before=0", "before=-1", "state=idle", "limit="]
)
def test_parameters_have_bounds(http, problem, query):
    told = problem(http.get(f"/api/v1/campaigns?{query}"), 422)
    assert told["field"] == query.partition("=")[0]


@pytest.mark.parametrize(
    "asked",
    [
        "campaigns?limit=1&limit=1",
        "campaigns?before=1&before=2",
        "suites?limit=2&limit=3",
        "campaigns/1/episodes?filter=&filter=steps>1&sort=index",
    ],
)
def test_a_parameter_of_one_value_is_given_once(http, problem, asked):
    told = problem(http.get(f"/api/v1/{asked}"), 422)
    assert told["field"] == asked.partition("?")[2].partition("=")[0]
    assert told["detail"] == f"{told['field']}: is given 2 times; only one value is allowed."
    assert told["remedy"]


@pytest.mark.parametrize(
    ("method", "path", "headers", "status", "words"),
    [
        ("GET", "/api/v1/methods", {"Accept": "text/csv"}, 406, "omit `Accept`"),
        ("POST", "/api/v1/campaigns", {"Content-Type": "text/csv"}, 415, "`Content-Type`"),
        ("POST", "/api/v1/campaigns", JSON, 413, "several requests"),
        ("PATCH", "/api/v1/campaigns", {}, 405, "/openapi.json"),
        ("GET", "/nothing", {}, 404, "/openapi.json"),
    ],
)
def test_what_the_framework_refuses_has_a_remedy(
    *, http, problem, method, path, headers, status, words
):
    content = b" " * 1_000_001 if status == 413 else b"{}"
    told = problem(http.request(method, path, content=content, headers=headers), status)
    assert words in told["remedy"]


def test_markup_in_names_stays_text(http, fields):
    name = "<script>alert('x')</script>=cmd|' /C calc'!A0"
    response = http.post("/api/v1/campaigns", json={**fields, "name": name})
    assert response.json()["spec"]["name"] == name
    assert response.headers["content-type"] == "application/json"
    assert response.headers["x-content-type-options"] == "nosniff"


@pytest.mark.fault(
    "internal error while a request is answered",
    group="api",
    outcome="A 500 in the same form as every problem, without anything of its inside.",
)
def test_a_fault_of_ours_tells_nothing_of_itself(http, store, problem, monkeypatch):
    monkeypatch.setattr(store.campaigns, "page", lambda *_: 1 / 0)
    response = http.get("/api/v1/campaigns")
    told = problem(response, 500)
    assert told["remedy"]
    assert "division" not in response.text


plain = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(),
    lambda inner: st.lists(inner) | st.dictionaries(st.text(), inner),
    max_leaves=10,
)
FIELDS = ["name", "method", "episodes", "seed", "settings", "scenario_parameters", "disturbance"]


@pytest.mark.fault("body that is malformed, deeply nested or too large")
@settings(
    max_examples=60,
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
@given(wrong=st.dictionaries(st.sampled_from(FIELDS) | st.text(), plain, min_size=1))
def test_no_body_whatever_is_a_fault_of_ours(http, fields, wrong):
    body = json.dumps(fields | wrong).encode("utf-8", "surrogatepass")
    response = http.post("/api/v1/campaigns", content=body, headers=JSON)
    assert response.status_code in {201, 400, 422}


@pytest.mark.parametrize(
    ("asked", "words"),
    [
        ("campaigns/x", "campaign: 'x' is not an integer."),
        ("campaigns/0", "campaign: 0 is below 1."),
        ("campaigns?limit=2000", "limit: 2000 is above 1000."),
        ("campaigns?state=runing", "state: 'runing' is not one of 'queued', 'running',"),
        ("campaigns/1/safety?level=1.5", "level: 1.5 is not below 1."),
        ("comparisons?a=1", "b: is required."),
        ("comparisons?a=1&b=x", "b: 'x' is not 1 to 100 ids, such as 1 or 1,2,3."),
        ("campaigns/" + "9" * 5000, "campaign: "),
    ],
)
def test_a_parameter_is_refused_in_plain_words(http, problem, asked, words):
    told = problem(http.get(f"/api/v1/{asked}"), 422)["detail"]
    assert told.startswith(words)
    assert "Input" not in told
