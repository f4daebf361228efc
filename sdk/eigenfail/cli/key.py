"""`eigenfail key`: make, list, limit and revoke keys; read the audit log."""

import re
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from time import time
from typing import Annotated, Any

import typer
from msgspec.structs import asdict

from eigenfail.cli.answers import prints_answer
from eigenfail.cli.connection import connect_to
from eigenfail.cli.options import AsJson, Database, Limit, Url
from eigenfail.cli.render import CommandResult, first_rows, to_json
from eigenfail.errors import InvalidValue
from eigenfail.hosting.folder import DEFAULT_URL
from eigenfail.hosting.service import load_database_tool
from eigenfail.presentation import tables
from eigenfail.presentation.campaigns import ID
from eigenfail.presentation.figures import format_utc
from eigenfail.values.access import UNLIMITED, ApiKey, AuditEntry, NewKey, Quotas, Scope
from eigenfail.wire.http import read_fields


def _describe_new_key(made: NewKey) -> str:
    """A key that was just made, with what its holder has to do."""
    key = made.key
    ends = "it is revoked" if key.expires_ms is None else f"{format_utc(key.expires_ms)}"
    return (
        f"Key {key.id} for '{key.name}', {key.scope}, until {ends}. It is shown only once:\n\n"
        f"{made.token}\n\n"
        "Put it into EIGENFAIL_KEY for commands and programs, or sign in with it at /login."
    )


def _tabulate_keys(keys: Iterable[ApiKey]) -> tables.Table:
    """One row for each key."""
    at_ms = round(1_000 * time())
    return tables.tabulate(
        "Keys",
        keys,
        tables.Reading(ID, lambda key: str(key.id)),
        tables.read_text("Name", "name"),
        tables.read_text("Scope", "scope"),
        tables.read_text("State", lambda key: key.find_state(at_ms)),
        tables.read_text("Quotas", _join_quotas),
        tables.read_utc("Made", "created_ms"),
        tables.read_utc("Ends", "expires_ms"),
        tables.read_utc("Last used", "last_used_ms"),
    )


def _join_quotas(key: ApiKey) -> str | None:
    given = asdict(key.quotas).items()
    return ", ".join(f"{name} {most:,}" for name, most in given if most is not None) or None


def _tabulate_audit(entries: Iterable[AuditEntry]) -> tables.Table:
    """One row for each change."""
    return tables.tabulate(
        "Changes",
        entries,
        tables.read_utc("When [UTC]", "at_ms"),
        tables.read_text("Who", "who"),
        tables.read_text("Key", lambda entry: entry.key and str(entry.key)),
        tables.read_text("What", lambda entry: f"{entry.method} {entry.route}"),
        tables.read_text("Subject", lambda entry: f"{entry.subject}\n{entry.details}".strip()),
        tables.read_text("From", lambda entry: entry.address or None),
        tables.read_number("Status", "status"),
    )


LIFE = re.compile(r"(?P<count>[1-9]\d{0,5})(?P<unit>[mhd])")
NO_LIMIT = "none"
# As many digits always fit into the 64 bits of a number in a database.
LONGEST_LIMIT = 18
SECONDS = {"m": 60, "h": 3_600, "d": 86_400}

app = typer.Typer(
    add_completion=False,
    no_args_is_help=True,
    help="Create, list, limit and revoke API keys; show the audit log.\n\n"
    "From the first key on, every request needs one, set in EIGENFAIL_KEY. With "
    "--database, keys are managed directly in the database, and no key is required.",
)

Name = Annotated[str, typer.Argument(help="User or program that the key is for.")]
Which = Annotated[Scope, typer.Option(help="Scope; each includes the one before.")]
Expires = Annotated[
    str | None, typer.Option(help="Lifetime: 90d, 12h, 30m (default: until revoked).")
]
MaxOpen = Annotated[
    str | None,
    typer.Option(metavar="N", help="Maximum number of open campaigns; none: no limit."),
]
MaxEpisodes = Annotated[
    str | None,
    typer.Option(metavar="N", help="Maximum budget of one campaign; none: no limit. [episodes]"),
]
MaxEpisodesPerDay = Annotated[
    str | None,
    typer.Option(
        metavar="N", help="Maximum sum of budgets within 24 hours; none: no limit. [episodes]"
    ),
]
KeyId = Annotated[int, typer.Argument(metavar="KEY", min=1, help="Id of a key.")]


@contextmanager
def open_keys(
    context: typer.Context, database: Database = None, url: Url = DEFAULT_URL
) -> Iterator[Any]:
    """Yield the keys of a database, if one is named; otherwise those of the service at the URL."""
    if database is not None:
        yield load_database_tool("keys")(database)
        return
    with connect_to(context, url) as client:
        yield client.keys


@app.command()
@prints_answer(opened_by=open_keys)
def create(
    keys: Any,
    name: Name,
    scope: Which = Scope.VIEWER,
    expires: Expires = None,
    max_open: MaxOpen = None,
    max_episodes: MaxEpisodes = None,
    max_episodes_per_day: MaxEpisodesPerDay = None,
) -> CommandResult:
    """Create a key and print it. It is shown only once."""
    # Read before anything is sent: what was mistyped must not make a key without limits.
    life = None if expires is None else parse_duration(expires)
    given = _change_quotas(UNLIMITED, max_open, max_episodes, max_episodes_per_day)
    made = keys.create(name, scope, life, given)
    return CommandResult(made, _describe_new_key(made))


@app.command("list")
@prints_answer(opened_by=open_keys)
def list_keys(keys: Any) -> CommandResult:
    """List keys, newest first, expired and revoked ones included."""
    found = tuple(keys.list())
    return CommandResult(found, _tabulate_keys(found))


@app.command()
@prints_answer(opened_by=open_keys)
def limit(
    keys: Any,
    key: KeyId,
    max_open: MaxOpen = None,
    max_episodes: MaxEpisodes = None,
    max_episodes_per_day: MaxEpisodesPerDay = None,
) -> CommandResult:
    """Change quotas of a key; other quotas and existing campaigns do not change."""
    # A quota that is not named keeps its value, and the service sets all of them.
    wanted = _change_quotas(keys.get(key).quotas, max_open, max_episodes, max_episodes_per_day)
    found = keys.limit(key, wanted)
    return CommandResult(found, _tabulate_keys([found]))


@app.command()
@prints_answer(opened_by=open_keys)
def revoke(keys: Any, key: KeyId) -> CommandResult:
    """Revoke a key permanently."""
    found = keys.revoke(key)
    return CommandResult(found, _tabulate_keys([found]))


@app.command()
@prints_answer(opened_by=open_keys)
def audit(keys: Any, limit: Limit = 50) -> CommandResult:
    """Show the audit log: changes with time, user, address and result, newest first."""
    return first_rows(keys.audit(), limit, _tabulate_audit)


@app.command()
def first(
    name: Annotated[str, typer.Argument(help="User or program that the key is for.")],
    file: Annotated[Path, typer.Option("--file", help="File to which the key is written.")],
    database: Database = None,
    as_json: AsJson = False,
) -> None:
    """Create an administrator's key in a file, unless there is one.

    Needs --database. It can be called at every start of a container.
    """
    if database is None:
        raise InvalidValue("--database", "is not given.", "Specify the service's database.")
    answer = load_database_tool("keys")(database).create_first(name, file)
    words = f"An administrator's key is in {answer.file}."
    if answer.made is None:
        words = "A valid administrator key already exists; no key was created."
    typer.echo(to_json(answer) if as_json else words)


def parse_duration(life: str) -> int:
    """Return the seconds of a duration such as 90d.

    Raises:
        InvalidValue: it is not written like that.
    """
    match = LIFE.fullmatch(life)
    if match is None:
        problem = f"'{life}' is not a valid duration."
        raise InvalidValue("expires", problem, "Write it like 90d, 12h or 30m.")
    return int(match["count"]) * SECONDS[match["unit"]]


def _change_quotas(before: Quotas, *given: str | None) -> Quotas:
    """Return the quotas with the given changes, in the order of their fields.

    Raises:
        InvalidValue: something is neither a number nor none.
    """
    wanted = zip(Quotas.__struct_fields__, given, strict=True)
    changes = {name: _parse_limit(name, text) for name, text in wanted if text is not None}
    return read_fields(asdict(before) | changes, Quotas)


def _parse_limit(name: str, text: str) -> int | None:
    """Parse a limit from the command line.

    Raises:
        InvalidValue: it is neither a number nor none.
    """
    if text == NO_LIMIT:
        return None
    # int() takes digits of other scripts, underscores, and numbers of any length.
    if not (text.isascii() and text.isdecimal() and len(text) <= LONGEST_LIMIT):
        problem = f"'{text[:40]}' is not a valid limit."
        raise InvalidValue(name, problem, f"Give a number, or {NO_LIMIT}.")
    return int(text)
