"""Refuses what a web page of somebody else's could make a browser send here."""

import re
from collections.abc import Collection
from urllib.parse import urlsplit

from starlette.datastructures import Headers
from starlette.types import ASGIApp, Receive, Scope, Send

from eigenfail.wire.problems import untyped_problem
from eigenfail_api.problems import answer

HOST = re.compile(r"(?P<name>\[[0-9a-f:.]+\]|[^\[\]:]+)(:\d+)?")


class Guard:
    """Middleware: the Host must be one of ours, and a page that sends must come from it.

    The first is against DNS rebinding, the second against forged requests; while nobody has to
    show a key, they are what keeps other people's pages out.

    Args:
        app: what is guarded.
        hosts: names under which we may be asked; None takes any.
    """

    def __init__(self, app: ASGIApp, hosts: Collection[str] | None) -> None:
        self._app = app
        self._hosts = None if hosts is None else {name.lower() for name in hosts}

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass on, or refuse."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        headers = Headers(scope=scope)
        host, origin = headers.get("host", ""), headers.get("origin")
        if not self._is_ours(host):
            detail = f"'{host}' is not a name of this service."
            remedy = "Ask for 127.0.0.1 or localhost, or have its name in EIGENFAIL_HOSTS."
            await answer(untyped_problem(400, detail, scope["path"], remedy))(scope, receive, send)
        elif origin is not None and place_of(origin) != host.lower():
            detail = f"Pages of '{origin}' may not ask here."
            remedy = "Use the service's own pages, or a client that is no browser."
            await answer(untyped_problem(403, detail, scope["path"], remedy))(scope, receive, send)
        else:
            await self._app(scope, receive, send)

    def _is_ours(self, host: str) -> bool:
        match = HOST.fullmatch(host.lower())
        return match is not None and (self._hosts is None or match["name"] in self._hosts)


def place_of(origin: str) -> str | None:
    """Host and port of an origin; None where it is no address."""
    try:
        return urlsplit(origin).netloc.lower()
    except ValueError:
        return None
