"""HEAD for whatever can be got, and a short answer where nothing has changed."""

import hashlib

from anyio import CancelScope
from starlette.datastructures import Headers, MutableHeaders
from starlette.types import ASGIApp, Message, Receive, Scope, Send

JSON = "application/json"


class Heads:
    """Middleware: HEAD is answered as GET would be, without the body."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass on, as GET."""
        if scope["type"] != "http" or scope["method"] != "HEAD":
            await self._app(scope, receive, send)
            return
        with CancelScope() as enough:

            async def send_head(message: Message) -> None:
                if message["type"] == "http.response.start":
                    await send(message)
                    await send({"type": "http.response.body", "body": b""})
                    # A stream would go on for good.
                    enough.cancel()

            await self._app({**scope, "method": "GET"}, receive, send_head)


class Etags:
    """Middleware: JSON that was got has an ETag; who has it already gets 304 and no body."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass on, holding back the head of JSON until its body is known."""
        if scope["type"] != "http" or scope["method"] != "GET":
            await self._app(scope, receive, send)
            return
        known = Headers(scope=scope).get("if-none-match", "")
        held: Message | None = None

        async def send_tagged(message: Message) -> None:
            nonlocal held
            if is_json(message):
                held = message
                return
            head, held = held, None
            if head is not None:
                if not message.get("more_body"):
                    message = tagged(head, message, known)
                await send(head)
            await send(message)

        await self._app(scope, receive, send_tagged)


def is_json(message: Message) -> bool:
    """Whether an answer that is JSON begins."""
    if message["type"] != "http.response.start" or message["status"] != 200:
        return False
    return Headers(raw=message["headers"]).get("content-type", "") == JSON


def tagged(head: Message, body: Message, known: str) -> Message:
    """The body to send; the head gets the tag, and becomes a 304 if the tag is known."""
    tag = f'"{hashlib.sha256(body.get("body", b"")).hexdigest()[:32]}"'
    headers = MutableHeaders(raw=head["headers"])
    headers.update({"ETag": tag, "Cache-Control": "no-cache"})
    if known != "*" and tag not in {one.strip().removeprefix("W/") for one in known.split(",")}:
        return body
    head["status"] = 304
    del headers["content-length"], headers["content-type"]
    return {**body, "body": b""}
