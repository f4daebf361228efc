"""Every error as application/problem+json (RFC 9457), whoever raised it."""

from collections.abc import Mapping
from typing import Any

from fastapi import Request
from fastapi.exceptions import RequestValidationError
from starlette.exceptions import HTTPException
from starlette.responses import Response

from eigenfail.errors import EigenfailError, InvalidValue, ServiceError
from eigenfail.values.access import redacted
from eigenfail.wire import http
from eigenfail.wire.problems import Problem, problem_of, untyped_problem
from eigenfail_api.headers import SECURITY
from eigenfail_api.refusals import told

SOON_S = "1"
WHAT_THERE_IS = "See /api, or /openapi.json, for what there is."
REMEDIES = {
    406: "Ask for one of these in `Accept`, or leave `Accept` out.",
    413: "Send many campaigns in several requests; EIGENFAIL_MAX_BODY_BYTES sets the limit.",
    415: "Send one of these, and name it in `Content-Type`.",
}
"""What to do next, where the framework's words say what was wrong."""


def answer(problem: Problem, headers: Mapping[str, str] | None = None) -> Response:
    """The response that carries a problem."""
    # A surprise is answered outside of the middleware that sets the security headers elsewhere.
    return Response(
        redacted(http.encode(problem).decode()),
        problem.status,
        {**SECURITY, **(headers or {})},
        media_type=http.PROBLEM_JSON,
    )


async def on_known_error(request: Request, error: EigenfailError) -> Response:
    """An error that was raised on purpose."""
    return answer(problem_of(error, request.url.path), later(error))


def later(error: EigenfailError) -> dict[str, str]:
    """The headers of a refusal that may be over soon."""
    return {"Retry-After": SOON_S} if isinstance(error, ServiceError) else {}


async def on_bad_parameter(request: Request, error: RequestValidationError) -> Response:
    """A path, query or header parameter of the wrong type or outside its bounds."""
    first = error.errors()[0]
    return await on_known_error(request, InvalidValue(str(first["loc"][-1]), told(first)))


async def on_http_error(request: Request, error: HTTPException) -> Response:
    """What the framework refuses by itself."""
    path = request.url.path
    words = {
        404: (f"There is nothing at {path}.", WHAT_THERE_IS),
        405: (f"{path} does not know {request.method}.", WHAT_THERE_IS),
    }
    others = (error.detail, REMEDIES.get(error.status_code, ""))
    detail, remedy = words.get(error.status_code, others)
    return answer(untyped_problem(error.status_code, detail, path, remedy), error.headers)


async def on_surprise(request: Request, _error: Exception) -> Response:
    """A fault of our own: the log has it all, the client learns only that."""
    detail = "The service failed at this request; its log says how."
    remedy = "Try again; if it happens again, report it with the lines of the log."
    return answer(untyped_problem(500, detail, request.url.path, remedy))


HANDLERS: dict[int | type[Exception], Any] = {
    EigenfailError: on_known_error,
    RequestValidationError: on_bad_parameter,
    HTTPException: on_http_error,
    Exception: on_surprise,
}
