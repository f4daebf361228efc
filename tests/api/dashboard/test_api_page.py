"""The page of the API: all of the OpenAPI document, and examples that work."""

import shlex

import pytest

from eigenfail_api.dashboard.reference_page import (
    describe_schema,
    find_kind,
    make_reference,
    sample,
)

ADDRESS = "http://127.0.0.1:8440"


@pytest.fixture
def document(app):
    return app.openapi()


@pytest.fixture
def view(document):
    return make_reference(document, ADDRESS)


@pytest.fixture
def operations(view):
    return [operation for group in view.groups for operation in group.operations]


def test_every_route_is_on_it_once(document, operations):
    told = {(path, verb.upper()) for path, item in document["paths"].items() for verb in item}
    assert sorted((each.path, each.verb) for each in operations) == sorted(told)


def test_every_schema_that_is_named_is_on_it(view, operations):
    there = {schema.name for schema in view.schemas}
    fields = [field for each in (*operations, *view.schemas) for field in fields_of(each)]
    assert {field.kind.reference for field in fields} - {""} <= there


def fields_of(told):
    return told.fields if hasattr(told, "fields") else told.parameters


def test_the_page_is_made_of_it(http, operations):
    page = http.get("/api", headers={"Accept": "text/html"})
    assert page.status_code == 200
    for operation in operations:
        assert f'id="{operation.id}"' in page.text
    assert page.text.count("data-try ") == sum(each.can_try for each in operations)
    assert "aria-current" in page.text.partition(">API</a>")[0].rpartition("<a")[2]


def test_examples_that_read_work(http, operations, campaign):
    """As far as one campaign without episodes has what they ask for."""
    words = [shlex.split(each.curl) for each in operations if each.can_try]
    answers = {tuple(line): http.get(line[-1]).status_code for line in words}
    assert {line[0] for line in words} == {"curl"}
    assert set(answers.values()) <= {200, 404, 409, 422}
    assert sum(status == 200 for status in answers.values()) > 20


def test_the_example_of_a_campaign_makes_one(http, operations):
    (create,) = [each for each in operations if each.id == "create_campaign"]
    *_, how, url, option, header, _, body = shlex.split(create.curl.replace("\\\n", ""))
    assert (how, option) == ("POST", "-H")
    kind = dict([header.split(": ")])
    assert http.post(url, content=body, headers=kind).status_code == 201


def test_streams_are_not_tried(operations):
    (stream,) = [each for each in operations if each.id == "follow_events"]
    assert not stream.can_try


@pytest.mark.parametrize(
    ("schema", "words"),
    [
        ({"type": "integer", "minimum": 1, "maximum": 50}, "integer ≥ 1, ≤ 50"),
        ({"type": "integer", "maximum": 2**63 - 1}, "integer"),
        ({"type": "number", "exclusiveMinimum": 0.0}, "number > 0.0"),
        ({"type": "array", "items": {"$ref": "#/components/schemas/A"}}, "list of A"),
        ({"type": "array", "prefixItems": [{"type": "number"}], "items": False}, "list of number"),
        ({"anyOf": [{"type": "string"}, {"type": "null"}]}, "string or null"),
        ({"enum": ["a", "b"]}, '"a" | "b"'),
        ({"type": "string", "maxLength": 9}, "string of at most 9 characters"),
        ({}, "anything"),
    ],
)
def test_schemas_in_words(schema, words):
    assert describe_schema(schema) == words


def test_a_kind_knows_which_schema_it_names():
    inner = {"anyOf": [{"type": "null"}, {"type": "array", "items": {"$ref": "#/x/Mode"}}]}
    assert find_kind(inner).reference == "Mode"


def test_samples_are_of_what_is_required():
    schemas = {
        "Spec": {
            "properties": {"name": {"type": "string"}, "n": {"minimum": 3}, "other": {}},
            "required": ["name", "n"],
        }
    }
    assert sample({"$ref": "#/x/Spec"}, schemas) == {"name": "name", "n": 3}
    assert sample({"type": "array", "minItems": 1, "items": {"const": "x"}}, {}) == ["x"]
