"""The OpenAPI document: complete, sound, and true."""

import jsonschema
import pytest
from referencing import Registry, Resource
from referencing.jsonschema import DRAFT202012

from eigenfail.values import Outcome
from eigenfail_api.app import ROUTERS


@pytest.fixture
def document(http):
    return http.get("/openapi.json").json()


@pytest.fixture
def conforms(document):
    """Holds a response against the schema that the document has for it."""
    registry = Registry().with_resource("doc:", Resource(document, DRAFT202012))

    def check(response, path, method="get"):
        told = document["paths"][path][method]["responses"]
        answer = told.get(str(response.status_code), told["default"])
        kind = response.headers["content-type"]
        reference = answer["content"][kind]["schema"]["$ref"]
        jsonschema.Draft202012Validator({"$ref": f"doc:{reference}"}, registry=registry).validate(
            response.json()
        )

    return check


def operations(document):
    return [
        (path, method, operation)
        for path, methods in document["paths"].items()
        for method, operation in methods.items()
    ]


def references(node):
    if isinstance(node, dict):
        yield from ([node["$ref"]] if "$ref" in node else [])
        for below in node.values():
            yield from references(below)
    if isinstance(node, list):
        for below in node:
            yield from references(below)


def test_every_route_is_in_it_once(document):
    routes = {
        (route.path, method.lower())
        for router in ROUTERS
        for route in router.routes
        if route.include_in_schema
        for method in route.methods
    }
    assert len(routes) >= 23
    assert routes == {(path, method) for path, method, _ in operations(document)}
    ids = [operation["operationId"] for _, _, operation in operations(document)]
    assert len(ids) == len(set(ids))


def test_every_reference_resolves(document):
    names = {f"#/components/schemas/{name}" for name in document["components"]["schemas"]}
    used = set(references(document))
    assert used <= names
    assert "#/components/schemas/CampaignSpec" in used


def test_every_schema_is_sound(document):
    for schema in document["components"]["schemas"].values():
        jsonschema.Draft202012Validator.check_schema(schema)


def test_every_answer_and_every_refusal_has_a_schema(document):
    for path, method, operation in operations(document):
        responses = operation["responses"]
        assert any(status.startswith("2") for status in responses), (path, method)
        for response in responses.values():
            for media in response["content"].values():
                assert "schema" in media, (path, method)
        assert operation["description"]
        if path != "/metrics":
            assert "application/problem+json" in responses["default"]["content"]


def test_bodies_are_described_where_they_are_read(document):
    with_bodies = {
        path for path, _, operation in operations(document) if "requestBody" in operation
    }
    assert with_bodies == {
        "/api/v1/campaigns",
        "/api/v1/campaigns/{campaign}/analyses",
        "/api/v1/analyses/{analysis}/proof",
    }


def test_answers_are_what_it_says(*, http, conforms, campaign, deliver, result, failed, finished):
    deliver(campaign, result(0), result(1, Outcome.COLLISION), failed(2))
    analysis, url = finished(), "/api/v1"
    one = f"{url}/campaigns/{{campaign}}"
    paths = {
        f"{url}/campaigns": {},
        f"{url}/campaigns/summaries": {},
        one: {},
        f"{one}/summary": {},
        f"{one}/course": {},
        f"{one}/digest": {},
        f"{one}/safety": {},
        f"{one}/cost": {},
        f"{one}/episodes": {},
        f"{one}/episodes/{{index}}": {"index": 1},
        f"{one}/analyses": {},
        f"{url}/analyses/{{analysis}}": {},
        f"{url}/analyses/{{analysis}}/eigenfailures": {},
        f"{url}/analyses/{{analysis}}/proof": {},
        f"{url}/methods": {},
        f"{url}/planners": {},
        f"{url}/scenarios": {},
        f"{url}/simulators": {},
        "/healthz": {},
        "/readyz": {},
    }
    for path, ids in paths.items():
        filled = path.format(**({"campaign": campaign, "analysis": analysis} | ids))
        response = http.get(filled)
        assert response.status_code == 200, filled
        conforms(response, path)


def test_refusals_are_what_it_says(http, conforms, fields):
    path = "/api/v1/campaigns"
    conforms(http.post(path, json={**fields, "planner": "x"}), path, "post")
    conforms(http.get("/api/v1/campaigns/9"), "/api/v1/campaigns/{campaign}")


def test_it_is_made_once(app):
    assert app.openapi() is app.openapi()
