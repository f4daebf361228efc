"""`eigenfail key`: who may do what, and who did what."""

import re
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Annotated

import typer
from msgspec.structs import asdict

from eigenfail.cli.db_options import Database
from eigenfail.cli.key_tables import audit_table, key_table, new_key
from eigenfail.cli.options import DEFAULT_URL, AsJson, Limit, Url
from eigenfail.cli.output import show, to_json
from eigenfail.cli.surroundings import client_at
from eigenfail.client.keys import Keys
from eigenfail.errors import InvalidValue
from eigenfail.hosting.keys import DatabaseKeys
from eigenfail.values.access import Scope
from eigenfail.values.quotas import UNLIMITED, Quotas
from eigenfail.wire.http import read_fields

LIFE = re.compile(r"(?P<count>[1-9]\d{0,5})(?P<unit>[mhd])")
NO_LIMIT = "none"
LONGEST_LIMIT = 18
SECONDS = {"m": 60, "h": 3_600, "d": 86_400}

app = typer.Typer(
    add_completion=False,
    no_args_is_help=True,
    help="Make, list, limit and revoke keys; read who changed what.\n\n"
    "From the first key on, everybody who asks the service needs one: EIGENFAIL_KEY. With "
    "--database, keys are tended on the database itself, and no key is asked for.",
)

Name = Annotated[str, typer.Argument(help="Who or what the key is for.")]
Which = Annotated[Scope, typer.Option(help="What it allows; each allows the one before, too.")]
Expires = Annotated[
    str | None, typer.Option(help="How long it is valid: 90d, 12h, 30m; until revoked if left out.")
]
MaxOpen = Annotated[
    str | None,
    typer.Option(metavar="N", help="Most campaigns at once that have not ended; none: no limit."),
]
MaxEpisodes = Annotated[
    str | None, typer.Option(metavar="N", help="Most episodes in one campaign; none: no limit.")
]
MaxEpisodesPerDay = Annotated[
    str | None,
    typer.Option(metavar="N", help="Most episodes in the campaigns of 24 hours; none: no limit."),
]
KeyId = Annotated[int, typer.Argument(metavar="ID", min=1, help="Id of a key.")]


@app.command()
def create(
    context: typer.Context,
    name: Name,
    scope: Which = Scope.VIEWER,
    expires: Expires = None,
    max_open: MaxOpen = None,
    max_episodes: MaxEpisodes = None,
    max_episodes_per_day: MaxEpisodesPerDay = None,
    database: Database = None,
    url: Url = DEFAULT_URL,
    as_json: AsJson = False,
) -> None:
    """Make a key, and print it: this once, it is kept nowhere."""
    with keys_at(context, url, database) as keys:
        life = None if expires is None else seconds(expires)
        given = quotas_of(UNLIMITED, max_open, max_episodes, max_episodes_per_day)
        made = keys.create(name, scope, life, given)
    typer.echo(to_json(made) if as_json else new_key(made))


@app.command("list")
def list_keys(
    context: typer.Context,
    database: Database = None,
    url: Url = DEFAULT_URL,
    as_json: AsJson = False,
) -> None:
    """List keys, newest first; those that are no longer valid, too."""
    with keys_at(context, url, database) as keys:
        found = tuple(keys.list())
    show(found, as_json, lambda: key_table(found))


@app.command()
def limit(
    context: typer.Context,
    key: KeyId,
    max_open: MaxOpen = None,
    max_episodes: MaxEpisodes = None,
    max_episodes_per_day: MaxEpisodesPerDay = None,
    database: Database = None,
    url: Url = DEFAULT_URL,
    as_json: AsJson = False,
) -> None:
    """Change the quotas that are named; the others stay, and so does what was made before."""
    with keys_at(context, url, database) as keys:
        before = keys.get(key).quotas
        wanted = quotas_of(before, max_open, max_episodes, max_episodes_per_day)
        found = keys.limit(key, wanted)
    show(found, as_json, lambda: key_table([found]))


@app.command()
def revoke(
    context: typer.Context,
    key: KeyId,
    database: Database = None,
    url: Url = DEFAULT_URL,
    as_json: AsJson = False,
) -> None:
    """Revoke a key, for good."""
    with keys_at(context, url, database) as keys:
        found = keys.revoke(key)
    show(found, as_json, lambda: key_table([found]))


@app.command()
def audit(
    context: typer.Context,
    limit: Limit = 50,
    database: Database = None,
    url: Url = DEFAULT_URL,
    as_json: AsJson = False,
) -> None:
    """Show who changed what, newest first: when, from where, and how it ended."""
    with keys_at(context, url, database) as keys:
        found = keys.audit().first(limit)
    show(found, as_json, lambda: audit_table(found))


@contextmanager
def keys_at(
    context: typer.Context, url: str, database: str | None
) -> Iterator[Keys | DatabaseKeys]:
    """The keys of a database, where one is named; else those of the service that is asked."""
    if database is not None:
        yield DatabaseKeys(database)
        return
    with client_at(context, url) as client:
        yield client.keys


def seconds(life: str) -> int:
    """A time such as 90d in seconds.

    Raises:
        InvalidValue: it is not written like that.
    """
    match = LIFE.fullmatch(life)
    if match is None:
        raise InvalidValue("expires", f"'{life}' is no time.", "Write it like 90d, 12h or 30m.")
    return int(match["count"]) * SECONDS[match["unit"]]


def quotas_of(before: Quotas, *given: str | None) -> Quotas:
    """Quotas with what is given, in the order of their fields, in the place of what was before.

    Raises:
        InvalidValue: something is neither a number nor none.
    """
    wanted = zip(Quotas.__struct_fields__, given, strict=True)
    changes = {name: limit_of(name, text) for name, text in wanted if text is not None}
    return read_fields(asdict(before) | changes, Quotas)


def limit_of(name: str, text: str) -> int | None:
    """A limit as somebody typed it.

    Raises:
        InvalidValue: it is neither a number nor none.
    """
    if text == NO_LIMIT:
        return None
    if not (text.isascii() and text.isdecimal() and len(text) <= LONGEST_LIMIT):
        raise InvalidValue(name, f"'{text[:40]}' is no limit.", f"Give a number, or {NO_LIMIT}.")
    return int(text)
