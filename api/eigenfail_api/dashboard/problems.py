"""Problems as pages, for whoever asks with a browser."""

from collections.abc import Callable, Coroutine, Mapping
from typing import Any

import msgspec
from fastapi import Request
from starlette.responses import Response

from eigenfail.wire.http import PREFIX
from eigenfail.wire.problems import Problem
from eigenfail_api.dashboard.rendering import page

Handler = Callable[[Request, Any], Coroutine[Any, Any, Response]]
Handlers = Mapping[int | type[Exception], Handler]

KEPT = ("allow", "retry-after", "content-security-policy")
KEPT_PREFIXES = ("x-", "referrer-")


def for_browsers(handlers: Handlers) -> dict[int | type[Exception], Handler]:
    """The handlers, answering in HTML where HTML was asked for."""
    return {kind: shown(handler) for kind, handler in handlers.items()}


def shown(handler: Handler) -> Handler:
    """A handler whose problem a person can read."""

    async def handle(request: Request, error: Any) -> Response:
        response = await handler(request, error)
        return as_page(response) if wants_page(request) else response

    return handle


def wants_page(request: Request) -> bool:
    """Whether a person is looking; programs ask the API, or do not ask for HTML."""
    accepts = request.headers.get("accept", "")
    return "text/html" in accepts and not request.url.path.startswith(f"{PREFIX}/")


def as_page(response: Response) -> Response:
    """The page that says what a problem says."""
    problem = msgspec.json.decode(response.body, type=Problem)
    shown_page = page("problem.html", problem, problem.status)
    for name, value in response.headers.items():
        if name in KEPT or name.startswith(KEPT_PREFIXES):
            shown_page.headers[name] = value
    return shown_page
