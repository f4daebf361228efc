"""Followers that go while they are told something: no fault of the service."""

from anyio import BrokenResourceError
from starlette.types import ASGIApp, Receive, Scope, Send


class Departures:
    """Lets them go: what feeds a stream learns late that nobody listens, and raises."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a request."""
        try:
            await self._app(scope, receive, send)
        except* BrokenResourceError:
            pass
