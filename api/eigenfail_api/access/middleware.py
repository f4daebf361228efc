"""Middleware that protects the service: origin checks, authentication, scopes and the audit log.

Keys are kept out of addresses, answers and logs.
"""

import logging
import re
import traceback
from collections.abc import AsyncIterator, Collection, Sequence
from contextlib import asynccontextmanager
from urllib.parse import quote, unquote_plus, urlsplit

from anyio.to_thread import run_sync
from msgspec.structs import asdict
from starlette.datastructures import Headers
from starlette.exceptions import HTTPException
from starlette.requests import HTTPConnection, Request
from starlette.responses import RedirectResponse, Response
from starlette.types import ASGIApp, Message, Receive, Send
from starlette.types import Scope as Asked

from eigenfail.errors import EigenfailError, Forbidden, InvalidValue, Unauthorized
from eigenfail.values.access import SECRET, Change, redact
from eigenfail.wire.http import PREFIX, Problem, make_problem, make_untyped_problem
from eigenfail_api.access import authentication
from eigenfail_api.access.change_details import read_details
from eigenfail_api.dashboard.rendering import as_page, wants_page
from eigenfail_api.middleware import holds
from eigenfail_api.parameters import make_outdated_error
from eigenfail_api.problems import answer, retry_headers
from eigenfail_services.store.store import Store

LOGGERS = ("uvicorn.error", "eigenfail.access", "asyncio")
LONGEST = 200
"""Most characters of a text in the audit log."""

CHALLENGE = {"WWW-Authenticate": 'Bearer realm="eigenfail"'}
HOST = re.compile(r"(?P<name>\[[0-9a-f:.]+\]|[^\[\]:]+)(:\d+)?")

log = logging.getLogger("eigenfail.access")


class OriginGuard:
    """Middleware: refuse foreign Host headers and requests from the pages of other sites.

    The first is against DNS rebinding, the second against forged requests. While no key is
    required, these checks alone keep the pages of other sites out.

    Args:
        app: the application to protect.
        hosts: names under which the service may be called; None takes any.
    """

    def __init__(self, app: ASGIApp, hosts: Collection[str] | None) -> None:
        self._app = app
        self._hosts = None if hosts is None else {name.lower() for name in hosts}

    async def __call__(self, scope: Asked, receive: Receive, send: Send) -> None:
        """Pass a request on, or refuse it."""
        problem = self._check(scope) if scope["type"] == "http" else None
        app = self._app if problem is None else answer(problem)
        await app(scope, receive, send)

    def _check(self, scope: Asked) -> Problem | None:
        headers = Headers(scope=scope)
        host, origin = headers.get("host", ""), headers.get("origin")
        match = HOST.fullmatch(host.lower())
        if match is None or (self._hosts is not None and match["name"] not in self._hosts):
            detail = f"'{host}' is not a name of this service."
            remedy = "Use 127.0.0.1 or localhost, or add the name to EIGENFAIL_HOSTS."
            return make_untyped_problem(400, detail, scope["path"], remedy)
        if origin is not None and _parse_origin(origin) != host.lower():
            detail = f"Requests from pages of '{origin}' are not allowed."
            remedy = "Use the pages of this service, or a client other than a browser."
            return make_untyped_problem(403, detail, scope["path"], remedy)
        return None


def _parse_origin(origin: str) -> str | None:
    """Return host and port of an origin; None if it is not an address."""
    try:
        return urlsplit(origin).netloc.lower()
    except ValueError:
        return None


class AuthMiddleware:
    """Middleware: require keys and scopes, and record changes in the audit log.

    Args:
        app: the application to protect.
        authenticator: identifies callers.
        store: store of the audit log.
        rules: which requests require which scope.
    """

    def __init__(
        self,
        app: ASGIApp,
        authenticator: authentication.Authenticator,
        store: Store,
        rules: Sequence[authentication.Rule],
    ) -> None:
        self._app = app
        self._authenticator = authenticator
        self._store = store
        self._rules = rules

    async def __call__(self, scope: Asked, receive: Receive, send: Send) -> None:
        """Pass a request on, or refuse it."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        request = Request(scope)
        try:
            _refuse_keys_in_address(scope)
            app, caller = await self._authorise(request)
        except (EigenfailError, HTTPException) as error:
            app, caller = _refuse(request, error), None
        is_refused = app is not self._app
        with authentication.act_as(caller):
            changes = authentication.is_change(request.method, scope["path"], self._rules)
            if caller is None or not (is_refused or changes):
                await app(scope, receive, send)
                return
            async with _record_change(self._store, request, caller, send) as send_and_record:
                await app(scope, receive, send_and_record)

    async def _authorise(self, request: Request) -> tuple[ASGIApp, authentication.Caller | None]:
        """Return the app that answers a request, and the caller if a key may be required."""
        required = authentication.required_scope(request.method, request.scope["path"], self._rules)
        if required is None:
            return self._app, None
        # While no key is required, no thread is needed and no request waits for the database.
        caller = self._authenticator.identify_anonymous(request)
        if caller is None:
            caller = await run_sync(self._authenticator.identify, request)
        if caller.scope.allows(required):
            return self._app, caller
        refusal = Forbidden(
            f"This needs a key with scope '{required}'; {caller.description} has scope "
            f"'{caller.scope}'.",
            "Request such a key from an administrator.",
        )
        return _refuse(request, refusal), caller


def _refuse_keys_in_address(scope: Asked) -> None:
    """Refuse a key in an address: proxies and browsers store addresses.

    Raises:
        InvalidValue: the address contains a key.
    """
    query = scope.get("query_string", b"").decode("latin-1")
    # The server has decoded the path, and not the query.
    if SECRET.search(scope["path"]) or SECRET.search(unquote_plus(query)):
        raise InvalidValue(
            "address",
            "A key must not be part of a URL, which others can read.",
            "Revoke that key, create another, and send it as `Authorization: Bearer ef_…`.",
        )


def _refuse(request: Request, error: EigenfailError | HTTPException) -> Response:
    """Return a refusal, as a page for browsers; those without a key are sent to the login."""
    path = request.url.path
    # A browser that fetches a piece of a page would put the page of the login into it.
    is_visit = request.method == "GET" and "hx-request" not in request.headers
    if isinstance(error, Unauthorized) and is_visit and wants_page(request):
        place, query = quote(request.scope["path"]), request.url.query
        back = quote(f"{place}?{query}" if query else place)
        return RedirectResponse(f"/login?next={back}", 303)
    if isinstance(error, HTTPException):
        problem = make_untyped_problem(
            error.status_code, error.detail, path, "Wait, and try again."
        )
        response = answer(problem, error.headers)
    else:
        headers = CHALLENGE if isinstance(error, Unauthorized) else retry_headers(error)
        response = answer(make_problem(error, path), headers)
    return as_page(response) if wants_page(request) else response


@asynccontextmanager
async def _record_change(
    store: Store, request: HTTPConnection, caller: authentication.Caller, send: Send
) -> AsyncIterator[Send]:
    """Yield a `send` that appends to the audit log before the answer leaves.

    A request that fails without an answer is recorded with status 500.
    """
    is_recorded = False

    async def append(subject: str, status: int) -> None:
        nonlocal is_recorded
        is_recorded = True
        await run_sync(append_change, store, describe_change(request, caller, subject, status))

    async def append_and_send(message: Message) -> None:
        if message["type"] == "http.response.start":
            location = Headers(raw=message["headers"]).get("location", "")
            # The line is written before the answer leaves: what a client knows to be done is in the
            # log.
            await append(location or request.scope["path"], message["status"])
        await send(message)

    try:
        yield append_and_send
    except Exception:
        if not is_recorded:
            await append(request.scope["path"], 500)
        raise


def describe_change(
    request: HTTPConnection, caller: authentication.Caller, subject: str, status: int
) -> Change:
    """Return the entry of the audit log for a request and its answer; keys are taken out."""
    route = request.scope.get("route")
    return Change(
        who=caller.name,
        key=caller.key,
        method=request.scope["method"],
        route=_redact(route.path if route else request.scope["path"]),
        subject=_redact(subject),
        address=_redact(authentication.address_of(request)),
        status=status,
        details=read_details(request.scope),
    )


def append_change(store: Store, change: Change) -> None:
    """Append to the audit log; if the store fails, write the entry to the process's log."""
    try:
        store.audit.append(change)
    except EigenfailError as error:
        log.error("not in the audit log: %s (%s)", asdict(change), error)  # noqa: TRY400


def _redact(text: str) -> str:
    return redact(text)[:LONGEST]


class Preconditions:
    """Middleware: refuse a change if its `If-Match` does not name the present version."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Asked, receive: Receive, send: Send) -> None:
        """Pass a request on, or answer 412."""
        is_change = (
            scope["type"] == "http"
            and scope["method"] not in authentication.SAFE
            and scope["path"].startswith(PREFIX)
        )
        is_conditional = is_change and "if-match" in Headers(scope=scope)
        if is_conditional and not await holds(self._app, scope, PREFIX):
            problem = make_problem(make_outdated_error(), scope["path"])
            await answer(problem)(scope, receive, send)
        else:
            await self._app(scope, receive, send)


class RedactingFilter(logging.Filter):
    """Takes keys out of log records and their tracebacks."""

    def filter(self, record: logging.LogRecord) -> bool:
        """Redact a record; none is dropped."""
        record.msg, record.args = redact(record.getMessage()), ()
        # A formatter prints `exc_text` if it is set, and formats the error itself otherwise, with
        # the key in it.
        if record.exc_info and not record.exc_text:
            record.exc_text = "".join(traceback.format_exception(*record.exc_info)).rstrip()
        if record.exc_text:
            record.exc_text = redact(record.exc_text)
        return True


REDACTING = RedactingFilter()


def redact_logs() -> None:
    """Take keys out of the logs of this process; calling it again changes nothing."""
    for name in LOGGERS:
        logging.getLogger(name).addFilter(REDACTING)
