"""`eigenfail db prune`, `vacuum` and `downgrade`: what is taken out of a database."""

from contextlib import nullcontext
from typing import Annotated

import typer
from rich.console import Group
from rich.markup import escape
from rich.text import Text

from eigenfail.cli.db_options import Database, said
from eigenfail.cli.options import DEFAULT_DATA, AsJson, Data
from eigenfail.cli.output import show, to_json
from eigenfail.cli.tables import table
from eigenfail.hosting.folder import DataFolder
from eigenfail.hosting.service import database_tool
from eigenfail.values.retention import DRAWN_AGAIN, KEEP_EVERY, PruneReport, Vacuumed

KeepEvery = Annotated[
    int, typer.Option("--keep-every", min=2, help="Of the others, every so-manyth keeps its noise.")
]
Source = Annotated[
    str,
    typer.Option(
        "--source",
        help="Of the noise that goes: prior, which follows from seeds; or trajectory, policy.",
    ),
]
OlderThan = Annotated[
    float, typer.Option("--older-than", min=0.0, help="Days since the campaign ended.")
]
Campaigns = Annotated[
    list[int], typer.Option("--campaign", show_default="all", help="Only this one; repeatable.")
]
DryRun = Annotated[bool, typer.Option("--dry-run", help="Say what would go, and end.")]
To = Annotated[str, typer.Option("--to", help="The revision, such as 0014.")]
Lose = Annotated[
    bool, typer.Option("--force", help="There is a backup: what only newer schemas hold may go.")
]


def prune(
    database: Database = None,
    data: Data = DEFAULT_DATA,
    keep_every: KeepEvery = KEEP_EVERY,
    source: Source = DRAWN_AGAIN,
    older_than: OlderThan = 0.0,
    campaigns: Campaigns = [],  # noqa: B006 - typer takes no tuple of any length
    dry_run: DryRun = False,
    as_json: AsJson = False,
) -> None:
    """Take away noise and scenes of episodes that did not fail, in campaigns that have ended.

    All rows stay, so that no figure changes; so do all failures. A service may use the database
    meanwhile. What is free then is used again; `eigenfail db vacuum` gives it back.
    """
    found = said(
        PruneReport,
        "rehearse-prune" if dry_run else "prune",
        database or DataFolder(data).database,
        *(f"--keep-every={keep_every}", f"--source={source}", f"--older-than={older_than}"),
        *(f"--campaign={number}" for number in campaigns),
    )
    show(found, as_json, lambda: pruned(found))


def pruned(found: PruneReport) -> Group:
    """What went, or would go, of each campaign and in all."""
    counted = {"episodes", "scenes", "bytes"}
    grid = table("campaign", "name", "episodes", "scenes", "bytes", right={"campaign", *counted})
    for each in found.campaigns:
        weight = each.weight
        sums = (f"{weight.episodes:,}", f"{weight.scenes:,}", f"{weight.bytes:,}")
        grid.add_row(str(each.campaign), escape(each.name), *sums)
    passed = ", ".join(map(str, found.in_use))
    notes = [Text(f"Left alone, since others learn from them: {passed}.")] if passed else []
    parts = [grid] if found.campaigns else []
    return Group(*parts, *notes, Text(sentence(found)))


def sentence(found: PruneReport) -> str:
    """All of it in words."""
    whole, verb = found.weight, "would lose" if found.is_rehearsal else "lost"
    return (
        f"{whole.episodes:,} episodes {verb} their noise and {whole.scenes:,} scenes: "
        f"{whole.bytes:,} bytes."
    )


def vacuum(database: Database = None, data: Data = DEFAULT_DATA, as_json: AsJson = False) -> None:
    """Give free room inside a database back to the disk.

    SQLite writes the file anew: stop the service first; there must be room for a second copy.
    PostgreSQL works beside a service.
    """
    folder = DataFolder(data)
    with nullcontext() if database else folder.claimed():
        done = said(Vacuumed, "vacuum", database or folder.database)
    given = max(0, done.bytes_before - done.bytes_after)
    told = f"{done.database} takes {done.bytes_after:,} bytes; {given:,} were given back."
    typer.echo(to_json(done) if as_json else told)


def downgrade(
    to: To,
    database: Database = None,
    data: Data = DEFAULT_DATA,
    force: Lose = False,
    as_json: AsJson = False,
) -> None:
    """Take the schema back to an older revision, for an older program; make a backup first.

    Nobody may use the database meanwhile. `eigenfail db upgrade` is the way forward.
    """
    folder = DataFolder(data)
    with nullcontext() if database else folder.claimed():
        where = database or folder.database
        revision = database_tool("downgrade", where, f"--to={to}", *["--force"] * force)
    told = f"The database's schema is at revision {revision}."
    typer.echo(to_json({"action": "downgrade", "said": revision}) if as_json else told)
