"""A request as curl, Python and command line, to copy from a page."""

import re
import shlex
from collections.abc import Callable, Mapping
from typing import Annotated, Any
from urllib.parse import parse_qsl, unquote, urlencode

import msgspec
from fastapi import APIRouter, Query, Request
from fastapi.responses import HTMLResponse

from eigenfail.errors import NotFound
from eigenfail.values.failures import FailureRequest
from eigenfail.wire.http import PREFIX
from eigenfail_api.dashboard.rendering import page

MARK = "TOML"

FLAGS = frozenset({"archived"})
"""Parameters of lists that are true where they are given."""

Values = Mapping[str, Any]


class CopiedRequest(msgspec.Struct, frozen=True, kw_only=True):
    """A request to the API.

    Attributes:
        method: GET or POST.
        path: below /api/v1, with ids in it.
        query: its parameters.
        body: content of the request, as plain data; None for none.
    """

    method: str
    path: str
    query: Values = {}
    body: Values | None = None


class Service(msgspec.Struct, frozen=True):
    """Where a request goes, and whether a key has to come with it."""

    address: str
    asks_for_key: bool = False


class Copies(msgspec.Struct, frozen=True):
    """One request as texts to copy: curl, Python and the command line.

    Attributes:
        cli: empty where the command line has no words for it.
    """

    curl: str
    python: str
    cli: str

    @property
    def texts(self) -> tuple[tuple[str, str], ...]:
        """Each with what it is called."""
        named = (("curl", self.curl), ("Python", self.python), ("CLI", self.cli))
        return tuple((name, text) for name, text in named if text)


class Words(msgspec.Struct, frozen=True):
    """How one kind of request is said.

    Attributes:
        python: an expression of `client`; names in braces are of the path.
        cli: behind `eigenfail`; empty where there is no such command.
        call: the arguments of the expression, from the query and the body.
        before: what the command line needs first, from the body.
        options: options of the command, from the query.
        parameters: parameters of the query that an address of a page may have.
    """

    python: str
    cli: str = ""
    call: Callable[[CopiedRequest], str] = lambda _: ""
    before: Callable[[CopiedRequest], str] = lambda _: ""
    options: Callable[[CopiedRequest], str] = lambda _: ""
    parameters: frozenset[str] = frozenset()


def format_arguments(asked: CopiedRequest) -> str:
    """Return the body as keyword arguments."""
    return ", ".join(f"{name}={value!r}" for name, value in (asked.body or {}).items())


def format_filter(asked: CopiedRequest) -> str:
    """Return the query of a list as keyword arguments."""
    given = ((name, True if name in FLAGS else value) for name, value in asked.query.items())
    return ", ".join(f"{name}={value!r}" for name, value in given)


def format_options(asked: CopiedRequest) -> str:
    """Return the query of a list as options of its command."""
    return "".join(
        f" --{name}" if name in FLAGS else f" --{name.replace('_', '-')}={shlex.quote(value)}"
        for name, value in asked.query.items()
    )


def format_spec_file(asked: CopiedRequest) -> str:
    """Return the shell command that writes the body to the file that a command reads."""
    return f"cat > campaign.toml <<'{MARK}'\n{to_toml(asked.body or {})}{MARK}\n"


WORDS: Mapping[tuple[str, str], Words] = {
    ("POST", "/campaigns"): Words(
        "client.campaigns.create({})",
        "campaign create campaign.toml",
        call=format_arguments,
        before=format_spec_file,
    ),
    ("GET", "/campaigns"): Words("list(client.campaigns.list())", "campaign list"),
    ("GET", "/campaigns/{campaign}"): Words(
        "client.campaigns.get({campaign})", "campaign show {campaign}"
    ),
    ("GET", "/campaigns/{campaign}/episodes"): Words(
        "list(client.episodes.list({campaign}))", "episode list {campaign}"
    ),
    ("GET", "/campaigns/{campaign}/episodes/{index}"): Words(
        "client.episodes.get({campaign}, {index})", "episode show {campaign}/{index}"
    ),
    ("GET", "/analyses/{analysis}"): Words("client.analyses.get({analysis})"),
    ("GET", "/analyses/{analysis}/modes"): Words(
        "client.analyses.modes({analysis})", "mode list {analysis}"
    ),
    ("POST", "/keys"): Words(
        "client.keys.create({})", "key create {name} --scope {scope}", call=format_arguments
    ),
    ("GET", "/suites"): Words("list(client.suites.list())", "suite list"),
    ("GET", "/suites/{suite}"): Words("client.suites.table({suite!r})", "suite show {suite}"),
    ("GET", "/releases"): Words("client.releases.list()", "release list"),
    ("GET", "/releases/{campaign}"): Words(
        "client.releases.get({campaign})", "release show {campaign}"
    ),
    ("GET", "/failures"): Words(
        "list(client.episodes.list_failures({}))",
        "episode failures",
        call=format_filter,
        options=format_options,
        parameters=frozenset(FailureRequest.__struct_fields__),
    ),
    ("GET", "/gates"): Words("list(client.gates.list())", "gate list"),
    ("GET", "/gates/{gate}"): Words("client.gates.get({gate})", "gate show {gate}"),
    ("GET", "/workers/present"): Words("client.present_workers()", "worker list"),
    ("GET", "/comparisons"): Words("client.campaigns.compare({a}, {b})", "compare {a} {b}"),
}
"""By method and path."""


def make_copies(service: Service, asked: CopiedRequest) -> Copies:
    """Return a request to a service as curl, Python and command line.

    Raises:
        KeyError: nothing is known of such a request.
    """
    words, names = find_words(asked)
    toml_fails = asked.body is not None and has_none(asked.body)
    return Copies(
        curl=format_curl(service, asked),
        python=format_python(service.address, asked, words, names),
        cli=""
        if toml_fails or not words.cli
        else format_command(service.address, asked, words, names),
    )


def find_words(asked: CopiedRequest) -> tuple[Words, dict[str, str]]:
    """How a request is said, and what stands for the names in its path."""
    for (method, pattern), words in WORDS.items():
        if method == asked.method and (match := as_regex(pattern).fullmatch(asked.path)):
            return words, {name: unquote(text) for name, text in match.groupdict().items()}
    raise KeyError(f"{asked.method} {asked.path}")


def as_regex(pattern: str) -> re.Pattern[str]:
    """A path with names in braces, as a regular expression: all are numbers but a suite's."""
    numbers = re.sub(r"\{(?!suite)(\w+)\}", r"(?P<\1>[0-9]{1,19})", pattern)
    return re.compile(numbers.replace("{suite}", "(?P<suite>.+)"))


def format_curl(service: Service, asked: CopiedRequest) -> str:
    """Return the request for a shell; the key comes from SDK's and command line's variable."""
    query = urlencode(asked.query)
    address = f"{service.address}{PREFIX}{asked.path}{'?' if query else ''}{query}"
    parts = [f"curl {shlex.quote(address)}"]
    if service.asks_for_key:
        parts.append('-H "Authorization: Bearer $EIGENFAIL_KEY"')
    if asked.body is not None:
        data = msgspec.json.encode(asked.body).decode()
        parts += ["-H 'Content-Type: application/json'", f"-d {shlex.quote(data)}"]
    return " \\\n  ".join(parts)


def format_python(base: str, asked: CopiedRequest, words: Words, names: Mapping[str, str]) -> str:
    """Return the request as a call of the SDK."""
    given = {**names, **{name: list_ids(value) for name, value in asked.query.items()}}
    expression = words.python.replace("{}", words.call(asked).replace("{", "{{").replace("}", "}}"))
    return (
        "from eigenfail.client import Client\n\n"
        f"with Client({base!r}) as client:\n"
        f"    print({expression.format(**given)})"
    )


def format_command(base: str, asked: CopiedRequest, words: Words, names: Mapping[str, str]) -> str:
    """Return the request as a command."""
    given = {**names, **asked.query, **{n: str(v) for n, v in (asked.body or {}).items()}}
    command = words.cli.format(**{name: shlex.quote(text) for name, text in given.items()})
    before, options = words.before(asked), words.options(asked)
    return f"{before}eigenfail {command}{options} --url {shlex.quote(base)}"


def list_ids(ids: str) -> str:
    """Return comma-separated ids as a list."""
    return f"[{', '.join(ids.split(','))}]"


def to_toml(table: Values) -> str:
    """A table of plain data as TOML, a line for each value; tables inside it are inline."""
    return "".join(
        f"{format_toml_key(name)} = {format_toml_value(value)}\n" for name, value in table.items()
    )


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


def read_service(request: Request) -> Service:
    """Return the service by the address of the request."""
    address = str(request.base_url).rstrip("/")
    return Service(address, asks_for_key=request.app.state.authenticator.requires_keys())


router = APIRouter(include_in_schema=False, default_response_class=HTMLResponse)

ApiPath = Annotated[
    str, Query(max_length=16_000, description="Path below /api/v1, with the filter of a list.")
]


def read_address(address: str) -> CopiedRequest:
    """Return the request for a path with a query.

    Raises:
        KeyError: nothing is known of such a path, or it does not have a parameter.
    """
    path, _, text = address.partition("?")
    query = dict(parse_qsl(text, keep_blank_values=True))
    asked = CopiedRequest(method="GET", path=path, query=query)
    words, _ = find_words(asked)
    if not query.keys() <= words.parameters:
        raise KeyError(address)
    return asked


@router.get("/copies")
def show_copies(request: Request, path: ApiPath) -> HTMLResponse:
    """Serve the request for a path as three texts to copy.

    Raises:
        NotFound: no page shows such a thing.
    """
    try:
        found = make_copies(read_service(request), read_address(path))
    except KeyError as error:
        raise NotFound(f"The request for '{path}' is unknown.") from error
    return page("copies.html", found)
