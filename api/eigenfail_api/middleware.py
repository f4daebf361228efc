"""Middleware for responses: security headers, HEAD, entity tags, clients that disconnect."""

import hashlib
from collections.abc import Iterable
from itertools import takewhile
from pathlib import PurePosixPath

from anyio import BrokenResourceError, CancelScope
from h11 import LocalProtocolError
from starlette.datastructures import Headers, MutableHeaders
from starlette.requests import ClientDisconnect
from starlette.routing import Match
from starlette.types import ASGIApp, Message, Receive, Scope, Send

SECURITY_HEADERS = {
    "Content-Security-Policy": (
        "default-src 'self'; script-src 'self'; style-src 'self'; img-src 'self' data:; "
        "frame-ancestors 'none'; form-action 'self'; base-uri 'none'; object-src 'none'"
    ),
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "X-Content-Type-Options": "nosniff",
    # Other sites learn nothing; `OriginGuard` sees which page a form was sent from.
    "Referrer-Policy": "same-origin",
}


class SecurityHeaders:
    """Middleware: add the security headers to every response."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass a request on."""

        async def send_with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                MutableHeaders(scope=message).update(SECURITY_HEADERS)
            await send(message)

        await self._app(scope, receive, send_with_headers)


JSON_TYPE = "application/json"


class HeadRequests:
    """Middleware: answer HEAD as GET, without the body."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass a request on, HEAD as GET."""
        if scope["type"] != "http" or scope["method"] != "HEAD":
            await self._app(scope, receive, send)
            return
        with CancelScope() as enough:

            async def send_head(message: Message) -> None:
                if message["type"] == "http.response.start":
                    await send(message)
                    await send({"type": "http.response.body", "body": b""})
                    # A stream would never end.
                    enough.cancel()

            await self._app({**scope, "method": "GET"}, receive, send_head)


class EntityTags:
    """Middleware: tag JSON answers; a client that has the current version gets 304 and no body."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass a request on; the head of a JSON answer waits until its body is known."""
        if scope["type"] != "http" or scope["method"] != "GET":
            await self._app(scope, receive, send)
            return
        known = Headers(scope=scope).get("if-none-match", "")
        held: Message | None = None

        async def send_tagged(message: Message) -> None:
            nonlocal held
            if _starts_json_answer(message):
                held = message
                return
            head, held = held, None
            if head is not None:
                if not message.get("more_body"):
                    message = _add_tag(head, message, known)
                await send(head)
            await send(message)

        await self._app(scope, receive, send_tagged)


def _starts_json_answer(message: Message) -> bool:
    if message["type"] != "http.response.start" or message["status"] != 200:
        return False
    return Headers(raw=message["headers"]).get("content-type", "") == JSON_TYPE


def _add_tag(head: Message, body: Message, known: str) -> Message:
    """Add the tag to a head, which becomes a 304 if the tag is known; return the body to send."""
    tag = make_tag(body.get("body", b""))
    headers = MutableHeaders(raw=head["headers"])
    headers.update({"ETag": tag, "Cache-Control": "no-cache"})
    if not is_named([known.replace("W/", "")], tag):  # the comparison of caches is the weak one
        return body
    head["status"] = 304
    del headers["content-length"], headers["content-type"]
    return {**body, "body": b""}


def make_tag(body: bytes) -> str:
    """Return the entity tag of a JSON answer."""
    return f'"{hashlib.sha256(body).hexdigest()[:32]}"'


def is_named(values: Iterable[str], tag: str) -> bool:
    """Return whether values of `If-Match` or `If-None-Match` name a tag; `*` names every one."""
    names = {name.strip() for value in values for name in value.split(",")}
    return not names.isdisjoint({"*", tag})


async def holds(app: ASGIApp, scope: Scope, root: str) -> bool:
    """Return whether the `If-Match` of a change names the present version at its address.

    As in RFC 9110, 13.1.1. An address without a GET changes a part of the resource above it:
    `/campaigns/1/pause` changes the campaign. If the resource does not exist or its address is
    refused, the change is let through, and its route refuses it (RFC 9110, 13.2.1).

    Args:
        app: application that answers HEAD with the entity tags of GET.
        scope: the request.
        root: path of the API; addresses above it are not searched.
    """
    wanted = Headers(scope=scope).getlist("if-match")
    path = PurePosixPath(scope["path"])
    above = (str(each) for each in (path, *path.parents))
    for place in takewhile(lambda each: each.startswith(f"{root}/"), above):
        asked = _ask_head(scope, place)
        if not any(each.matches(asked)[0] is Match.FULL for each in scope["app"].routes):
            continue
        status, tag = await _read_head(app, asked)
        is_refused = 400 <= status < 500
        return is_refused or (status == 200 and bool(tag) and is_named(wanted, tag))
    return False


def _ask_head(scope: Scope, path: str) -> Scope:
    """Return a request for the entity tag of an address, by the user of another request."""
    # These headers describe the body of the change and its condition, and this request has neither.
    left_out = {b"if-match", b"content-length", b"content-type", b"transfer-encoding", b"accept"}
    headers = [(name, value) for name, value in scope["headers"] if name not in left_out]
    return {
        **scope,
        "method": "GET",
        "path": path,
        "raw_path": path.encode(),
        "query_string": b"",
        "headers": headers,
    }


async def _read_head(app: ASGIApp, asked: Scope) -> tuple[int, str]:
    """Return the status and the entity tag of the answer to a request."""
    head: list[Message] = []

    async def receive() -> Message:
        return {"type": "http.request", "body": b"", "more_body": False}

    async def keep(message: Message) -> None:
        head.append(message)

    # As HEAD, a stream of events ends with its head.
    await app({**asked, "method": "HEAD"}, receive, keep)
    return head[0]["status"], Headers(raw=head[0]["headers"]).get("etag", "")


class Disconnects:
    """Middleware: ignore errors that come from clients who disconnect during a request.

    Code that writes a stream or reads a body notices late that the client has gone. A client must
    not be able to fill the log with tracebacks. The server itself refuses a request whose body is
    malformed, and hangs up; a later answer goes to a client who has gone.
    """

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a request."""
        try:
            await self._app(scope, receive, send)
        except* (BrokenResourceError, ClientDisconnect, LocalProtocolError):
            pass
