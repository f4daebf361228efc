"""Middleware for responses: security headers, HEAD, entity tags, clients that disconnect."""

import hashlib

from anyio import BrokenResourceError, CancelScope
from starlette.datastructures import Headers, MutableHeaders
from starlette.requests import ClientDisconnect
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
            if _begins_json(message):
                held = message
                return
            head, held = held, None
            if head is not None:
                if not message.get("more_body"):
                    message = _add_tag(head, message, known)
                await send(head)
            await send(message)

        await self._app(scope, receive, send_tagged)


def _begins_json(message: Message) -> bool:
    if message["type"] != "http.response.start" or message["status"] != 200:
        return False
    return Headers(raw=message["headers"]).get("content-type", "") == JSON_TYPE


def _add_tag(head: Message, body: Message, known: str) -> Message:
    """Add the tag to a head, which becomes a 304 if the tag is known; return the body to send."""
    tag = f'"{hashlib.sha256(body.get("body", b"")).hexdigest()[:32]}"'
    headers = MutableHeaders(raw=head["headers"])
    headers.update({"ETag": tag, "Cache-Control": "no-cache"})
    if known != "*" and tag not in {one.strip().removeprefix("W/") for one in known.split(",")}:
        return body
    head["status"] = 304
    del headers["content-length"], headers["content-type"]
    return {**body, "body": b""}


class Disconnects:
    """Middleware: ignore errors that come from clients who disconnect during a request.

    Code that writes a stream or reads a body notices late that the client has gone. A client must
    not be able to fill the log with tracebacks.
    """

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a request."""
        try:
            await self._app(scope, receive, send)
        except* (BrokenResourceError, ClientDisconnect):
            pass
