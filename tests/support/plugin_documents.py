"""Checks of the OpenAPI document of a service with a plug-in, for the tests of plug-ins."""

import json
from pathlib import Path

from borrowed_fixtures import borrow

CHECKS = (
    "document",
    "test_every_reference_resolves",
    "test_every_schema_is_sound",
    "test_every_answer_and_every_refusal_has_a_schema",
    "test_parameters_cannot_be_null",
    "test_every_integer_that_a_client_sends_has_a_maximum",
    "test_no_integer_of_a_request_is_an_error_of_the_service",
)


def borrow_checks():
    """Return the document's fixture and the tests of the core's document, by name."""
    core = borrow("api", "test_openapi.py")
    return {name: core[name] for name in CHECKS}


def check_additions(document, paths):
    """Check that a plug-in adds these paths to the core's document, and changes nothing else."""
    stored = Path(__file__).parents[2] / "api" / "openapi.json"
    core = json.loads(stored.read_text())
    assert document["paths"].keys() - core["paths"].keys() == paths
    for path, item in core["paths"].items():
        assert document["paths"][path] == item
    schemas = document["components"]["schemas"]
    expected = core["components"]["schemas"]
    assert {name: schemas[name] for name in expected} == expected
