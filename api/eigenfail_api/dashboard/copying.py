"""A request as a curl command to copy."""

import shlex
from collections.abc import Mapping
from typing import Annotated, Any

import msgspec
from fastapi import APIRouter, Query, Request
from fastapi.responses import HTMLResponse

from eigenfail.errors import NotFound
from eigenfail.wire.http import PREFIX
from eigenfail_api.dashboard.rendering import page

Values = Mapping[str, Any]


class Service(msgspec.Struct, frozen=True):
    """The address of the service, and whether its requests need a key."""

    address: str
    asks_for_key: bool = False


def read_service(request: Request) -> Service:
    """Return the service by the address of the request."""
    address = str(request.base_url).rstrip("/")
    return Service(address, asks_for_key=request.app.state.authenticator.requires_keys())


def format_curl(service: Service, path: str, body: Values | None = None) -> str:
    """Return a request as a shell command, with the key from the variable of the SDK.

    Args:
        service: service that receives the request.
        path: path below /api/v1, with ids and query.
        body: body of a POST request, as plain data; None for a GET request.
    """
    # A filter contains spaces and characters that have a meaning in a shell.
    parts = [f"curl {shlex.quote(f'{service.address}{PREFIX}{path}')}"]
    if service.asks_for_key:
        # In double quotes the shell replaces the variable: the key itself is on no page.
        parts.append('-H "Authorization: Bearer $EIGENFAIL_KEY"')
    if body is not None:
        data = msgspec.json.encode(body).decode()
        parts += ["-H 'Content-Type: application/json'", f"-d {shlex.quote(data)}"]
    return " \\\n  ".join(parts)


router = APIRouter(include_in_schema=False, default_response_class=HTMLResponse)

ApiPath = Annotated[
    str, Query(max_length=16_000, description="Path below /api/v1, with the filter of a list.")
]


@router.get("/copies")
def show_copies(request: Request, path: ApiPath) -> HTMLResponse:
    """Serve the request for a path as a text to copy.

    Raises:
        NotFound: it is not a path.
    """
    if not path.startswith("/"):
        raise NotFound(f"'{path}' is not a path below {PREFIX}.")
    return page("copies.html", format_curl(read_service(request), path))
