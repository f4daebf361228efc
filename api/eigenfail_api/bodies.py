"""Bodies in and out: structs of the SDK as JSON."""

from collections.abc import Awaitable, Callable
from typing import Any, TypeVar

import msgspec
from fastapi import HTTPException, Request
from fastapi.responses import JSONResponse

from eigenfail.wire import http

Body = TypeVar("Body", bound=msgspec.Struct)
Plain = TypeVar("Plain", dict[str, Any], list[Any])


class Json(JSONResponse):
    """A struct as JSON."""

    def render(self, content: Any) -> bytes:
        """The bytes of the body."""
        return http.encode(content)


def body_of(kind: type[Body]) -> Callable[[Request], Awaitable[Body]]:
    """A dependency: the body of the request.

    It raises ProtocolError, UnknownName or InvalidValue, as `read_body` does.
    """

    async def read(request: Request) -> Body:
        return http.read_body(await read_within(request), kind)

    return read


def plain_body(kind: type[Plain]) -> Callable[[Request], Awaitable[Plain]]:
    """A dependency: the body of the request as plain data; nothing at all stands for none.

    It raises ProtocolError for what is no JSON, and InvalidValue for JSON of another kind.
    """

    async def read(request: Request) -> Plain:
        return http.read_plain(await read_within(request), kind)

    return read


async def read_within(request: Request) -> bytes:
    """The bytes of a request's body, as far as they are within the limit.

    Raises:
        HTTPException: 413, they are not.
    """
    most = request.app.state.settings.max_body_bytes
    data = bytearray()
    async for part in request.stream():
        data += part
        if len(data) > most:
            raise HTTPException(413, f"The body is larger than {most} bytes.")
    return bytes(data)
