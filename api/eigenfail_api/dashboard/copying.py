"""What a page gives to take along: a request as a curl command, a suite as a TOML file."""

import re
import shlex
from collections.abc import Mapping, Sequence
from typing import Annotated, Any

import msgspec
from fastapi import APIRouter, Query, Request
from fastapi.responses import HTMLResponse

from eigenfail.errors import NotFound
from eigenfail.suites import list_leaves
from eigenfail.wire.http import PREFIX
from eigenfail_api.dashboard.rendering import page

Values = Mapping[str, Any]


class Service(msgspec.Struct, frozen=True):
    """Where a request goes, and whether a key has to come with it."""

    address: str
    asks_for_key: bool = False


def read_service(request: Request) -> Service:
    """Return the service by the address of the request."""
    address = str(request.base_url).rstrip("/")
    return Service(address, asks_for_key=request.app.state.authenticator.requires_keys())


def format_curl(service: Service, path: str, body: Values | None = None) -> str:
    """Return a request as a shell command, with the key from the variable of the SDK.

    Args:
        service: where the request goes.
        path: below /api/v1, with ids and query.
        body: what is posted, as plain data; None to get what is there.
    """
    parts = [f"curl {shlex.quote(f'{service.address}{PREFIX}{path}')}"]
    if service.asks_for_key:
        parts.append('-H "Authorization: Bearer $EIGENFAIL_KEY"')
    if body is not None:
        data = msgspec.json.encode(body).decode()
        parts += ["-H 'Content-Type: application/json'", f"-d {shlex.quote(data)}"]
    return " \\\n  ".join(parts)


def to_toml(table: Values) -> str:
    """A table of plain data as TOML, a line for each value; tables inside it are inline."""
    return "".join(
        f"{format_toml_key(name)} = {format_toml_value(value)}\n" for name, value in table.items()
    )


def to_suite_toml(suite: Values) -> str:
    """Return a suite as its file: a table for each of its parts, a line for each value in it."""
    plain = {name: value for name, value in suite.items() if not isinstance(value, Mapping)}
    tables = (
        f"\n[{name}]\n{''.join(format_leaf(path, leaf) for path, leaf in list_leaves(value))}"
        for name, value in suite.items()
        if isinstance(value, dict)
    )
    return to_toml(plain) + "".join(tables)


def format_leaf(path: Sequence[str], value: Any) -> str:
    """Return a line of TOML for the value at a path."""
    return f"{'.'.join(map(format_toml_key, path))} = {format_toml_value(value)}\n"


def format_toml_value(value: Any) -> str:
    """Return a value as TOML; text is quoted as in JSON, which TOML reads as well."""
    if isinstance(value, Mapping):
        parts = (
            f"{format_toml_key(name)} = {format_toml_value(part)}" for name, part in value.items()
        )
        return f"{{{', '.join(parts)}}}"
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(format_toml_value, value))}]"
    return msgspec.json.encode(value).decode()


def format_toml_key(name: str) -> str:
    """Return a name, quoted where TOML requires quotes."""
    return name if re.fullmatch(r"[A-Za-z0-9_-]+", name) else msgspec.json.encode(name).decode()


def has_none(value: Any) -> bool:
    """Whether a value contains a null, which TOML does not have."""
    if isinstance(value, Mapping):
        return any(map(has_none, value.values()))
    if isinstance(value, list | tuple):
        return any(map(has_none, value))
    return value is None


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
