"""The OpenAPI document, with all that a reader needs: `python -m eigenfail_api.openapi`."""

import argparse
import json
import re
import sys
from collections.abc import Iterator
from http import HTTPStatus
from pathlib import Path
from typing import Any

from fastapi import FastAPI

from eigenfail.errors import EigenfailError
from eigenfail.wire.problems import NAMESPACE, SERVER_SIDE, UNTYPED, slug, tree
from eigenfail_api import schemas

Node = dict[str, Any]

TAGS = {
    "campaigns": "Budgeted searches for failures: create, follow, steer, sum up, compare.",
    "episodes": "The simulation runs of a campaign: a list, one with all that is kept of it.",
    "analyses": "Failures grouped into failure modes, and their proof by replay.",
    "suites": "Named sets of campaigns that are run, resumed and judged as one.",
    "events": "What happened, as a list or as it happens.",
    "workers": "Who runs the episodes.",
    "plug-ins": "What campaigns can name: methods, planners, scenarios, simulators.",
    "keys": "Who may do what, and the audit log of who did what; for administrators.",
    "operations": "For those who run the service: alive, ready, figures for Prometheus.",
}
WORDS = {
    "200": "What was asked for.",
    "201": "It was made; `Location` is its address.",
    "202": "It was queued; `Location` is where its state can be read.",
    "list": "They were made.",
}
LOCATION = {
    "description": "The address of what was made or queued.",
    "schema": {"type": "string", "format": "uri-reference"},
}
ETAG = {
    "description": "Send it as `If-None-Match`: an unchanged answer comes as 304 without a body.",
    "schema": {"type": "string"},
}
KEY = {
    "type": "http",
    "scheme": "bearer",
    "description": "A key, `ef_<id>_<secret>`: needed by everybody from the first one on.",
}
EXAMPLES: dict[str, Node] = {
    "create_campaign": {"name": "first try", "method": "monte_carlo", "episodes": 100},
    "check_campaign": {"name": "first try", "method": "monte_carlo", "episodes": 100},
    "clone_campaign": {"name": "another seed", "seed": 1},
    "create_key": {"name": "nightly pipeline", "scope": "runner", "expires_s": 7_776_000},
    "create_analysis": {"components": 20, "clusters": 4},
}
EVERYWHERE = (400, 401, 403, 406, 422, 500, 503)
WITH_ID = (404, 409, 410)
WITH_BODY = (409, 410, 413, 415)
MADE = ("201", "202")

ATTRIBUTE = re.compile(r"(?P<name>\w+): (?P<words>.+)")


def document_of(app: FastAPI) -> Node:
    """The app's document, made once: with schemas, and what routes do not say themselves."""
    is_new = app.openapi_schema is None
    document = schemas.openapi(app)
    if is_new:
        complete(document)
    return document


def complete(document: Node) -> None:
    """Describe tags, parameters, answers, refusals and fields."""
    operations = [one for item in document["paths"].values() for one in item.values()]
    used = {tag for operation in operations for tag in operation["tags"]}
    document["tags"] = [
        {"name": tag, "description": words} for tag, words in TAGS.items() if tag in used
    ]
    document["components"]["securitySchemes"] = {"key": KEY}
    refused = sorted({*EVERYWHERE, *WITH_ID, *WITH_BODY})
    document["components"]["responses"] = {str(status): refusal(status) for status in refused}
    for path, item in document["paths"].items():
        for verb, operation in item.items():
            complete_operation(path, verb, operation)
    for name in sorted(document["components"]["schemas"]):
        describe_fields(document["components"]["schemas"][name])


def complete_operation(path: str, verb: str, operation: Node) -> None:
    """Say which answers and which refusals there are."""
    operation["summary"] = operation["operationId"].replace("_", " ").capitalize()
    for parameter in operation.get("parameters", []):
        leave_out_null(parameter)
    if operation["operationId"] in EXAMPLES:
        body = operation["requestBody"]["content"][schemas.JSON]
        body["example"] = EXAMPLES[operation["operationId"]]
    responses = operation["responses"]
    for status, response in responses.items():
        describe_answer(verb, status, response)
    for status in refusals(path, operation):
        responses.setdefault(str(status), {"$ref": f"#/components/responses/{status}"})
    operation["responses"] = dict(sorted(responses.items()))


def describe_answer(verb: str, status: str, response: Node) -> None:
    """Put words and headers where the framework has only a phrase."""
    known = WORDS.get("list" if status in MADE and is_list(response) else status)
    if known and response.get("description", "") in {"", "Successful Response"}:
        response["description"] = known
    if status in MADE and not is_list(response):
        response.setdefault("headers", {})["Location"] = LOCATION
    if verb == "get" and status == "200" and [*response.get("content", {})] == [schemas.JSON]:
        response.setdefault("headers", {})["ETag"] = ETAG


def is_list(response: Node) -> bool:
    """Whether an answer is a page of things that have an address each."""
    schema = response["content"][schemas.JSON]["schema"]
    return str(schema.get("$ref", "")).rpartition("/")[2].startswith("Page_")


def refusals(path: str, operation: Node) -> Iterator[int]:
    """With which statuses a route can refuse."""
    yield from EVERYWHERE
    if "{" in path:
        yield from WITH_ID
    if "requestBody" in operation:
        yield from WITH_BODY


def refusal(status: int) -> Node:
    """An answer that is a problem, with the types that it can have."""
    types = ", ".join(f"`{kind}`" for kind in problem_types(status))
    return {**schemas.refusal(), "description": f"{HTTPStatus(status).phrase}: {types}."}


def problem_types(status: int) -> list[str]:
    """The types of the problems that have a status."""
    kinds = [kind for kind in tree(EigenfailError) if kind.http_status == status]
    typed = sorted(NAMESPACE + slug(kind) for kind in kinds)
    # An error on the service's own side that is no trouble of a part of it is told without a type.
    return [UNTYPED] if not typed or status == SERVER_SIDE else typed


def leave_out_null(parameter: Node) -> None:
    """Null is what a parameter is when it is not sent; nobody can send it."""
    kinds = parameter["schema"].get("anyOf", [])
    others = [kind for kind in kinds if kind != {"type": "null"}]
    if len(kinds) > len(others) == 1:
        del parameter["schema"]["anyOf"]
        parameter["schema"] |= others[0]


def describe_fields(schema: Node) -> None:
    """Give each field the words that its struct's docstring has for it."""
    summary, _, attributes = schema.get("description", "").partition("Attributes:\n")
    if not attributes:
        return
    schema["description"] = " ".join(summary.split())
    for name, words in told_fields(attributes):
        if name in schema["properties"]:
            schema["properties"][name].setdefault("description", words)


def told_fields(attributes: str) -> Iterator[tuple[str, str]]:
    """The entries of a docstring's list of attributes; longer ones go on further to the right."""
    lines = [line.rstrip() for line in attributes.splitlines() if line.strip()]
    margin = min((len(line) - len(line.lstrip()) for line in lines), default=0)
    entries: list[str] = []
    for line in lines:
        if len(line) - len(line.lstrip()) == margin:
            entries.append(line.strip())
        else:
            entries[-1] += f" {line.strip()}"
    found = (ATTRIBUTE.fullmatch(entry) for entry in entries)
    yield from ((match["name"], match["words"]) for match in found if match)


def written(document: Node) -> str:
    """The document as text, the same for the same document."""
    return json.dumps(document, indent=1, ensure_ascii=False) + "\n"


def main(words: list[str] | None = None) -> None:
    """Print the document, or write it."""
    from eigenfail_api.app import create_app
    from eigenfail_api.settings import ApiSettings
    from eigenfail_services.store import open_store

    parser = argparse.ArgumentParser(prog="eigenfail_api.openapi", description=__doc__)
    parser.add_argument("--output", type=Path, help="a file instead of standard output")
    output = parser.parse_args(words).output
    store = open_store("memory://")
    text = written(document_of(create_app(store, ApiSettings())))
    store.close()
    if output:
        output.write_text(text)
    else:
        sys.stdout.write(text)


if __name__ == "__main__":
    main()
