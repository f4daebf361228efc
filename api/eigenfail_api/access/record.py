"""The audit log's pen: writes down who changed what, before the answer leaves."""

import logging
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

from anyio.to_thread import run_sync
from msgspec.structs import asdict
from starlette.datastructures import Headers
from starlette.requests import HTTPConnection
from starlette.types import Message, Send

from eigenfail.contracts import Store
from eigenfail.errors import EigenfailError
from eigenfail.values.access import Change, redacted
from eigenfail_api.access.callers import Caller
from eigenfail_api.access.door import address_of

LONGEST = 200

log = logging.getLogger("eigenfail.access")


@asynccontextmanager
async def recorded(
    store: Store, asked: HTTPConnection, caller: Caller, send: Send
) -> AsyncIterator[Send]:
    """The way of an answer, with a line of the audit log on it; a fault of ours leaves one, too."""
    is_told = False

    async def tell(subject: str, status: int) -> None:
        nonlocal is_told
        is_told = True
        await run_sync(record, store, change(asked, caller, subject, status))

    async def send_and_tell(message: Message) -> None:
        if message["type"] == "http.response.start":
            location = Headers(raw=message["headers"]).get("location", "")
            await tell(location or asked.scope["path"], message["status"])
        await send(message)

    try:
        yield send_and_tell
    except Exception:
        if not is_told:
            await tell(asked.scope["path"], 500)
        raise


def change(asked: HTTPConnection, caller: Caller, subject: str, status: int) -> Change:
    """What somebody changed, or tried to."""
    route = asked.scope.get("route")
    return Change(
        who=caller.name,
        key=caller.key,
        method=asked.scope["method"],
        route=told(route.path if route else asked.scope["path"]),
        subject=told(subject),
        address=told(address_of(asked)),
        status=status,
    )


def record(store: Store, change: Change) -> None:
    """Write it down; where that cannot be, at least in the log."""
    try:
        store.audit.append(change)
    except EigenfailError as error:
        log.error("not in the audit log: %s (%s)", asdict(change), error)  # noqa: TRY400


def told(text: str) -> str:
    """A text from anywhere, short and without a key."""
    return redacted(text)[:LONGEST]
