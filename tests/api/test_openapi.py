"""The OpenAPI document: complete, sound, and true."""

import json
import re
from pathlib import Path
from typing import Annotated

import jsonschema
import msgspec
import pytest
from pydantic import TypeAdapter
from referencing import Registry, Resource
from referencing.jsonschema import DRAFT202012
from store_checks.gates import make_report
from store_checks.releases import release

from eigenfail.errors import EigenfailError
from eigenfail.gate.verdicts import GateVerdict
from eigenfail.wire.http import list_error_types, slugify
from eigenfail_api.app import FORMS, ROUTERS
from eigenfail_api.openapi import parse_attributes

ROOT = Path(__file__).parents[2]


@pytest.fixture
def document(http):
    return http.get("/openapi.json").json()


@pytest.fixture
def conforms(document):
    """Holds a response against the schema that the document has for it."""
    registry = Registry().with_resource("doc:", Resource(document, DRAFT202012))

    def check(response, path, method="get"):
        told = document["paths"][path][method]["responses"]
        answer = resolved(document, told.get(str(response.status_code), told["default"]))
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
        (route.path_format, method.lower())
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
    names = {
        f"#/components/{kind}/{name}"
        for kind, all_of in document["components"].items()
        for name in all_of
    }
    used = set(references(document))
    assert used <= names
    assert "#/components/schemas/CampaignSpec" in used


def test_every_schema_is_sound(document):
    for schema in document["components"]["schemas"].values():
        jsonschema.Draft202012Validator.check_schema(schema)


def resolved(document, response):
    name = response.get("$ref", "").removeprefix("#/components/responses/")
    return document["components"]["responses"][name] if name else response


def test_every_answer_and_every_refusal_has_a_schema(document):
    for path, method, operation in operations(document):
        responses = operation["responses"]
        assert any(status.startswith("2") for status in responses), (path, method)
        for response in (resolved(document, each) for each in responses.values()):
            for media in response["content"].values():
                assert "schema" in media, (path, method)


def test_everything_is_described(document):
    assert document["tags"]
    known = {tag["name"] for tag in document["tags"] if tag["description"]}
    for path, method, operation in operations(document):
        assert set(operation["tags"]) <= known, path
        assert operation["description"].endswith("."), (path, method)
        for parameter in operation.get("parameters", []):
            assert parameter.get("description"), (path, parameter["name"])
        for status, response in operation["responses"].items():
            words = resolved(document, response)["description"]
            assert words not in {"", "Successful Response"}, (path, status)


def test_every_refusal_names_the_types_of_its_problems(document):
    for _, _, operation in operations(document):
        assert {"400", "401", "403", "406", "422", "503"} <= operation["responses"].keys()
    for status, response in document["components"]["responses"].items():
        assert "application/problem+json" in response["content"]
        assert ("urn:eigenfail:" in response["description"]) is (
            status in {"400", "401", "403", "404", "409", "410", "412", "422", "503"}
        )
    told = " ".join(each["description"] for each in document["components"]["responses"].values())
    for kind in list_error_types(EigenfailError):
        if kind.http_status != 500:
            assert f"`urn:eigenfail:{slugify(kind)}`" in told


def test_a_long_entry_of_a_docstring_is_one():
    text = "    a: the first,\n        with more: of it.\n    b: the second.\n"
    assert [*parse_attributes(text)] == [
        ("a", "the first, with more: of it."),
        ("b", "the second."),
    ]


def test_parameters_cannot_be_null(document):
    told = [p for _, _, each in operations(document) for p in each.get("parameters", [])]
    assert told
    assert [p["name"] for p in told if {"type": "null"} in p["schema"].get("anyOf", [])] == []


def test_the_file_in_the_repository_is_it(document):
    kept = json.loads((ROOT / "api" / "openapi.json").read_text())
    assert kept == document, "Run `make docs`."


@pytest.mark.parametrize(
    ("kind", "name"),
    [
        ("methods", "monte_carlo"),
        ("planners", "idm"),
        ("scenarios", "cut_in"),
        ("simulators", "highway"),
    ],
)
def test_answers_about_plug_ins_are_what_it_says(http, conforms, kind, name):
    response = http.get(f"/api/v1/{kind}/{name}")
    assert response.status_code == 200
    conforms(response, f"/api/v1/{kind}/{{name}}")


def test_it_is_made_once(app):
    assert app.openapi() is app.openapi()


def test_answers_about_releases_are_what_it_says(http, conforms, store):
    release(store, "v1", {"late": 20})
    newest = release(store, "v2", {"hard": 20}, seed=1)
    store.campaigns.add_code(newest.id, {"idm_stack": "aa11"})
    conforms(http.get("/api/v1/releases"), "/api/v1/releases")
    conforms(http.get(f"/api/v1/releases/{newest.id}"), "/api/v1/releases/{campaign}")
    conforms(http.get(f"/api/v1/campaigns/{newest.id}"), "/api/v1/campaigns/{campaign}")


def test_answers_about_gates_are_what_it_says(http, conforms):
    report = msgspec.to_builtins(make_report(GateVerdict.NEW))
    made = http.post("/api/v1/gates", json=report)
    conforms(made, "/api/v1/gates", "post")
    conforms(http.get("/api/v1/gates"), "/api/v1/gates")
    conforms(http.get(made.headers["Location"]), "/api/v1/gates/{gate}")


LARGEST = 2**63 - 1
BEYOND = 2**63


def integers(document, node, place=()):
    """Yield places, and schemas, of the integers that a schema lets a client send."""
    if "$ref" in node:
        name = node["$ref"].rpartition("/")[2]
        if name in place:  # a schema within itself
            return
        node, place = document["components"]["schemas"][name], (*place, name)
    if node.get("type") == "integer":
        yield place, node
    below = [*node.get("anyOf", []), *node.get("allOf", []), *node.get("prefixItems", [])]
    below += [
        node[key] for key in ("items", "additionalProperties") if isinstance(node.get(key), dict)
    ]
    for each in below:
        yield from integers(document, each, place)
    for name, each in node.get("properties", {}).items():
        yield from integers(document, each, (*place, name))


def sent(document):
    """Yield path, method, parameter and schema of everything that a client sends."""
    for path, method, operation in operations(document):
        for parameter in operation.get("parameters", []):
            yield path, method, parameter["name"], parameter["schema"]
        for media in operation.get("requestBody", {}).get("content", {}).values():
            yield path, method, "", media["schema"]


def test_every_integer_that_a_client_sends_has_a_maximum(document):
    found = [
        (path, method, name, place, schema)
        for path, method, name, given in sent(document)
        for place, schema in integers(document, given)
    ]
    assert len(found) > 100
    unbounded = [each[:-1] for each in found if not each[-1].get("maximum", BEYOND) <= LARGEST]
    assert unbounded == []


def test_every_integer_parameter_of_every_page_has_a_maximum():
    def parameters(dependant):
        yield from (*dependant.path_params, *dependant.query_params, *dependant.header_params)
        for below in dependant.dependencies:
            yield from parameters(below)

    found = 0
    for router in (*ROUTERS, *FORMS):
        for route in router.routes:
            for each in parameters(route.dependant):
                schema = TypeAdapter(
                    Annotated[each.field_info.annotation, each.field_info]
                ).json_schema()
                for _, number in integers(
                    {"components": {"schemas": schema.get("$defs", {})}}, schema
                ):
                    found += 1
                    assert number.get("maximum", BEYOND) <= LARGEST, (route.path, each.alias)
    assert found > 100


def place_beyond(document, node, seen=()):
    """Yield bodies of which one integer is too large; what else they need is left out."""
    if "$ref" in node:
        name = node["$ref"].rpartition("/")[2]
        if name in seen:
            return
        node, seen = document["components"]["schemas"][name], (*seen, name)
    if node.get("type") == "integer":
        yield BEYOND
        yield -BEYOND - 1
    for each in (*node.get("anyOf", []), *node.get("allOf", [])):
        yield from place_beyond(document, each, seen)
    if isinstance(node.get("items"), dict):
        yield from ([each] for each in place_beyond(document, node["items"], seen))
    for name, each in node.get("properties", {}).items():
        yield from ({name: value} for value in place_beyond(document, each, seen))


def test_no_integer_of_a_request_is_an_error_of_the_service(http, document):
    requests = 0
    for path, method, name, schema in sent(document):
        ids = dict.fromkeys(("campaign", "analysis", "mode", "key", "gate"), 1)
        ids |= dict.fromkeys(("index", "cluster", "version"), 0)
        for given in place_beyond(document, schema):
            if name:
                number = given[0] if isinstance(given, list) else given
                asked = {"params": {name: number}}
                ids = {**ids, name: number}
            else:
                asked = {"json": given}
            fields = {part: ids.get(part, 1) for part in re.findall(r"{(\w+)}", path)}
            response = http.request(method, path.format(**fields), **asked)
            requests += 1
            assert 400 <= response.status_code < 500, (method, path, name, given, response.text)
    assert requests > 200
