"""Asks everybody for a key, where keys are needed, and holds its scope against the request."""

from urllib.parse import quote

from anyio.to_thread import run_sync
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import RedirectResponse, Response
from starlette.types import ASGIApp, Receive, Send
from starlette.types import Scope as Asked

from eigenfail.contracts import Store
from eigenfail.errors import EigenfailError, Forbidden, Unauthorized
from eigenfail.values.access import Scope
from eigenfail.wire.problems import problem_of, untyped_problem
from eigenfail_api.access.callers import Caller, acting
from eigenfail_api.access.door import Door
from eigenfail_api.access.record import recorded
from eigenfail_api.access.scopes import changes, needed
from eigenfail_api.access.secrets import refuse_keys_in_address
from eigenfail_api.dashboard.problems import as_page, wants_page
from eigenfail_api.problems import answer, later

CHALLENGE = {"WWW-Authenticate": 'Bearer realm="eigenfail"'}


class Gate:
    """Middleware: who may come in, does; what they change is written down.

    Args:
        app: what is behind it.
        door: who knows the keys.
        store: of the audit log.
    """

    def __init__(self, app: ASGIApp, door: Door, store: Store) -> None:
        self._app = app
        self._door = door
        self._store = store

    async def __call__(self, scope: Asked, receive: Receive, send: Send) -> None:
        """Pass on, or refuse."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        request = Request(scope)
        try:
            refuse_keys_in_address(scope)
            app, caller = await self._let_in(request)
        except (EigenfailError, HTTPException) as error:
            app, caller = refused(request, error), None
        with acting(caller):
            if caller is None or not (
                app is not self._app or changes(request.method, scope["path"])
            ):
                await app(scope, receive, send)
                return
            async with recorded(self._store, request, caller, send) as telling:
                await app(scope, receive, telling)

    async def _let_in(self, request: Request) -> tuple[ASGIApp, Caller | None]:
        """What answers, and who asks, where that has to be known."""
        least = needed(request.method, request.scope["path"])
        if least is None:
            return self._app, None
        caller = self._door.anybody(request)
        if caller is None:
            caller = await run_sync(self._door.caller, request)
        allowed = caller.scope.allows(least)
        return self._app if allowed else refused(request, short(caller, least)), caller


def short(caller: Caller, least: Scope) -> Forbidden:
    """The refusal of whoever has a key that allows too little."""
    return Forbidden(
        f"This needs a key of the scope '{least}'; that of '{caller.name}' is '{caller.scope}'.",
        "Ask an administrator for such a key.",
    )


def refused(request: Request, error: EigenfailError | HTTPException) -> Response:
    """A refusal, as whoever asks can read it; browsers that may sign in are sent to do so."""
    path = request.url.path
    if isinstance(error, Unauthorized) and is_visit(request):
        return RedirectResponse(f"/login?next={quote(address(request))}", 303)
    if isinstance(error, HTTPException):
        problem = untyped_problem(error.status_code, error.detail, path, "Wait, and try again.")
        response = answer(problem, error.headers)
    else:
        challenge = CHALLENGE if isinstance(error, Unauthorized) else later(error)
        response = answer(problem_of(error, path), challenge)
    return as_page(response) if wants_page(request) else response


def is_visit(request: Request) -> bool:
    """Whether a browser opens a page, and does not ask for a piece of one."""
    return request.method == "GET" and wants_page(request) and "hx-request" not in request.headers


def address(request: Request) -> str:
    """What was asked for, without the name of the service."""
    path, query = quote(request.scope["path"]), request.url.query
    return f"{path}?{query}" if query else path
