"""Errors as application/problem+json (RFC 9457)."""

from collections.abc import Mapping
from typing import Any

from fastapi import Request
from fastapi.exceptions import RequestValidationError
from starlette.exceptions import HTTPException
from starlette.responses import Response

from eigenfail.errors import EigenfailError, InvalidValue, ServiceError
from eigenfail.values.access import redact
from eigenfail.wire import http
from eigenfail.wire.http import Problem, make_problem, make_untyped_problem
from eigenfail_api.middleware import SECURITY_HEADERS
from eigenfail_api.parameters import FORMS

PARAMETER_WORDS = {
    "missing": "is required.",
    "int_parsing": "{input!r} is not an integer.",
    "float_parsing": "{input!r} is not a number.",
    "bool_parsing": "{input!r} is neither true nor false.",
    "greater_than": "{input} is not above {gt:g}.",
    "greater_than_equal": "{input} is below {ge}.",
    "less_than": "{input} is not below {lt:g}.",
    "less_than_equal": "{input} is above {le}.",
    "enum": "{input!r} is not one of {expected}.",
    "string_too_short": "is empty.",
    "string_too_long": "is longer than {max_length} characters.",
    "string_pattern_mismatch": "{input!r} is not {form}.",
    "string_type": "{input!r} is not text.",
    "tuple_type": "{input!r} is not a list.",
    "dict_type": "{input!r} is not an object of names and values.",
    "ip_v4_network": "{input!r} is not a network such as 10.0.0.5/32.",
    "ip_v6_network": "{input!r} is not a network such as 10.0.0.5/32.",
}
"""Sentences by the framework's name of an error, with places for the value and its bound."""

MOST_SHOWN = 60
"""Most characters of a wrong value that a sentence quotes."""


def describe_error(error: Mapping[str, Any]) -> str:
    """Return a sentence on a wrong value; the framework's sentence if the table lacks one."""
    words = PARAMETER_WORDS.get(error["type"], "{msg}.")
    given = error["input"]
    shown = given if not isinstance(given, str) else given[:MOST_SHOWN]
    bounds = error.get("ctx", {})
    form = FORMS.get(bounds.get("pattern", ""), "in the expected format")
    return words.format_map({**bounds, "input": shown, "form": form, "msg": error["msg"]})


WHAT_THERE_IS = "See /openapi.json for the available routes."
REMEDIES = {
    406: "Request one of these types in `Accept`, or omit `Accept`.",
    413: "Send many campaigns in several requests; EIGENFAIL_MAX_BODY_BYTES sets the limit.",
    415: "Send one of these types, and name it in `Content-Type`.",
}
"""Remedies of errors that the framework describes."""


def answer(problem: Problem, headers: Mapping[str, str] | None = None) -> Response:
    """Return the response for a problem."""
    # Unexpected errors are answered outside of the middleware that adds the security headers.
    return Response(
        # A problem may quote a wrong value, and this value may be a key.
        redact(http.encode(problem).decode()),
        problem.status,
        {**SECURITY_HEADERS, **(headers or {})},
        media_type=http.PROBLEM_JSON,
    )


async def on_known_error(request: Request, error: EigenfailError) -> Response:
    """Answer an error of the project's own tree."""
    return answer(make_problem(error, request.url.path), retry_headers(error))


def retry_headers(error: EigenfailError) -> dict[str, str]:
    """Return the headers of an error that may pass soon."""
    return {"Retry-After": "1"} if isinstance(error, ServiceError) else {}


async def on_bad_parameter(request: Request, error: RequestValidationError) -> Response:
    """Answer a path, query or header parameter of the wrong type or outside its bounds."""
    first = error.errors()[0]
    return await on_known_error(request, InvalidValue(str(first["loc"][-1]), describe_error(first)))


async def on_http_error(request: Request, error: HTTPException) -> Response:
    """Answer a request that the framework refuses."""
    path = request.url.path
    words = {
        404: (f"{path} does not exist.", WHAT_THERE_IS),
        405: (f"{path} does not support {request.method}.", WHAT_THERE_IS),
    }
    others = (error.detail, REMEDIES.get(error.status_code, ""))
    detail, remedy = words.get(error.status_code, others)
    return answer(make_untyped_problem(error.status_code, detail, path, remedy), error.headers)


async def on_unexpected_error(request: Request, _error: Exception) -> Response:
    """Answer an unexpected error: details are in the log alone."""
    detail = "Internal error; see the log of the service."
    remedy = "Try again; if the error persists, report it with the log lines."
    return answer(make_untyped_problem(500, detail, request.url.path, remedy))


HANDLERS: dict[int | type[Exception], Any] = {
    EigenfailError: on_known_error,
    RequestValidationError: on_bad_parameter,
    HTTPException: on_http_error,
    Exception: on_unexpected_error,
}
