"""The OpenAPI document with the extension: held to what the core's document is held to."""

import json

from borrowed_fixtures import borrow

CORE = borrow("api", "test_openapi.py")
document = CORE["document"]
test_every_reference_resolves = CORE["test_every_reference_resolves"]
test_every_schema_is_sound = CORE["test_every_schema_is_sound"]
test_every_answer_and_every_refusal_has_a_schema = CORE[
    "test_every_answer_and_every_refusal_has_a_schema"
]
test_parameters_cannot_be_null = CORE["test_parameters_cannot_be_null"]
test_every_integer_that_a_client_sends_has_a_maximum = CORE[
    "test_every_integer_that_a_client_sends_has_a_maximum"
]
test_no_integer_of_a_request_is_an_error_of_the_service = CORE[
    "test_no_integer_of_a_request_is_an_error_of_the_service"
]


PATHS = {
    "/api/v1/webhooks",
    "/api/v1/webhooks/{webhook}",
    "/api/v1/webhooks/{webhook}/test",
}


def test_the_routes_and_their_answers_are_in_it(document, plugin):
    readme = (plugin / "README.md").read_text()
    for path in PATHS:
        for operation in document["paths"][path].values():
            assert operation["description"] in readme
    made = document["paths"]["/api/v1/webhooks"]["post"]["responses"]["201"]["content"]
    assert made["application/json"]["schema"] == {"$ref": "#/components/schemas/NewWebhook"}


def test_all_else_is_the_document_of_the_core(document, plugin):
    core = json.loads((plugin.parents[1] / "api" / "openapi.json").read_text())
    assert document["paths"].keys() - core["paths"].keys() == PATHS
    for path, item in core["paths"].items():
        assert document["paths"][path] == item
    schemas = document["components"]["schemas"]
    assert {name: schemas[name] for name in core["components"]["schemas"]} == (
        core["components"]["schemas"]
    )
