"""`eigenfail db`: create, upgrade, check, back up, restore and thin out a database."""

from collections.abc import Iterator
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from typing import Annotated

import msgspec
import typer
from rich.console import Group
from rich.markup import escape
from rich.table import Table
from rich.text import Text

from eigenfail.cli.options import AsJson, Data, Database, Repair, Replay
from eigenfail.cli.render import show, to_json
from eigenfail.errors import InvalidValue
from eigenfail.hosting.folder import DEFAULT_DATA, DataFolder
from eigenfail.hosting.service import require_installed
from eigenfail.presentation.terminal import start_grid
from eigenfail.progress import announce
from eigenfail.values import operations

# SQLAlchemy and Alembic are imported by the commands that need them: `--help` works without.

DEFECTS_FOUND = 1

app = typer.Typer(
    add_completion=False,
    no_args_is_help=True,
    help="Create, upgrade, verify, back up, restore and prune a database.",
)

File = Annotated[Path, typer.Argument(metavar="FILE", help="The backup.")]
Force = Annotated[bool, typer.Option("--force", help="Replace existing data.")]
KeepEvery = Annotated[
    int,
    typer.Option(
        "--keep-every", min=2, help="Keep the noise of every N-th episode that did not fail."
    ),
]
Source = Annotated[
    str,
    typer.Option(
        "--source",
        help="Source of the noise to remove: prior, which follows from seeds; or trajectory, "
        "policy.",
    ),
]
OlderThan = Annotated[
    float, typer.Option("--older-than", min=0.0, help="Days since the campaign ended.")
]
Campaigns = Annotated[
    list[int],
    typer.Option("--campaign", show_default="all", help="Only this campaign; repeatable."),
]
DryRun = Annotated[bool, typer.Option("--dry-run", help="Report what would be removed, and end.")]


@app.callback()
def _require_server() -> None:
    require_installed()


@app.command()
def upgrade(database: Database = None, data: Data = DEFAULT_DATA, as_json: AsJson = False) -> None:
    """Create the schema, or upgrade it to this release."""
    from eigenfail_services.store import migrate

    url = database or DataFolder(data).database
    with announce("Upgrading the schema"):
        migrate.upgrade(url)
    words = "The database's schema is at revision {}, which is this program's."
    _show_revision("upgrade", _find_revision(url), words, as_json)


@app.command()
def current(database: Database = None, data: Data = DEFAULT_DATA, as_json: AsJson = False) -> None:
    """Print the schema's revision."""
    revision = _find_revision(database or DataFolder(data).database)
    _show_revision("current", revision, "{}", as_json)


@app.command()
def check(database: Database = None, data: Data = DEFAULT_DATA, as_json: AsJson = False) -> None:
    """Check whether the schema is that of this release; exit with 3 if not."""
    from eigenfail_services.store import open_store

    url = database or DataFolder(data).database
    open_store(url, migrate=False).close()
    words = "The database's schema is this program's: revision {}."
    _show_revision("check", _find_revision(url), words, as_json)


@app.command()
def verify(
    database: Database = None,
    data: Data = DEFAULT_DATA,
    replay: Replay = 0,
    repair: Repair = False,
    as_json: AsJson = False,
) -> None:
    """Verify the contents of a database; exit with 1 if there are defects.

    A service may use it meanwhile.
    """
    from eigenfail_services.upkeep import verify as verification

    with announce("Verifying the database"):
        found = verification.verify(database or DataFolder(data).database, replay, repair=repair)
    show(found, as_json, lambda: _draw_verification(found))
    if found.defects:
        raise typer.Exit(DEFECTS_FOUND)


@app.command()
def backup(
    file: File,
    database: Database = None,
    data: Data = DEFAULT_DATA,
    force: Force = False,
    as_json: AsJson = False,
) -> None:
    """Back up a SQLite database to a file; a running service may use it meanwhile.

    The file appears once it is complete and checked. For PostgreSQL, use pg_dump.
    """
    from eigenfail_services.upkeep import backup as backups

    with announce(f"Writing {file}"):
        made = backups.backup(database or DataFolder(data).database, file, force=force)
    words = f"{made.file} holds all of {made.database} ({made.bytes} bytes)."
    typer.echo(to_json(made) if as_json else words)


@app.command()
def restore(
    file: File,
    database: Database = None,
    data: Data = DEFAULT_DATA,
    force: Force = False,
    as_json: AsJson = False,
) -> None:
    """Restore a backup into an empty database, or with --force over an existing one.

    Either everything is restored or nothing changes. Stop all services of the database first.
    For PostgreSQL, use pg_restore.
    """
    from eigenfail_services.upkeep import backup as backups

    with _claim(database, data), announce(f"Restoring {file}"):
        restored = backups.restore(database or DataFolder(data).database, file, force=force)
    words = f"{restored.database} holds what {restored.file} held (schema {restored.revision})."
    typer.echo(to_json(restored) if as_json else words)


@app.command()
def prune(
    database: Database = None,
    data: Data = DEFAULT_DATA,
    keep_every: KeepEvery = operations.KEEP_EVERY,
    source: Source = operations.DRAWN_AGAIN,
    older_than: OlderThan = 0.0,
    campaigns: Campaigns = [],  # noqa: B006 - typer takes no tuple of any length
    dry_run: DryRun = False,
    as_json: AsJson = False,
) -> None:
    """Remove noise and scenes of safe episodes in campaigns that have ended.

    Rows and failures stay, and with them counts, rates, measures and costs. A running service
    may use the database meanwhile. Freed space is reused; `eigenfail db vacuum` returns it to
    the disk.
    """
    from eigenfail_services.upkeep import maintenance

    act = maintenance.rehearse if dry_run else maintenance.prune
    which = maintenance.PruneSelection(tuple(campaigns), older_than)
    kept = _retention(keep_every, source)
    with announce("Counting what would be removed" if dry_run else "Removing noise and scenes"):
        found = act(database or DataFolder(data).database, kept, which)
    show(found, as_json, lambda: _draw_pruning(found))


@app.command()
def vacuum(database: Database = None, data: Data = DEFAULT_DATA, as_json: AsJson = False) -> None:
    """Return free space inside a database to the disk.

    SQLite rewrites the file: stop the service first, and leave room for a second copy.
    With PostgreSQL the service may keep running.
    """
    from eigenfail_services.upkeep import maintenance as vacuuming

    with _claim(database, data), announce("Returning free space to the disk"):
        done = vacuuming.vacuum(database or DataFolder(data).database)
    freed = max(0, done.bytes_before - done.bytes_after)
    words = f"{done.database} takes {done.bytes_after:,} bytes; {freed:,} were given back."
    typer.echo(to_json(done) if as_json else words)


def _claim(database: str | None, data: Path) -> AbstractContextManager[None]:
    # Other clients of a database that is named on the command line are the user's business.
    return nullcontext() if database else DataFolder(data).claimed()


def _find_revision(url: str) -> str:
    from eigenfail_services.store import migrate

    return migrate.read_version(url) or "empty"


def _show_revision(action: str, revision: str, words: str, as_json: bool) -> None:
    answer = {"action": action, "said": revision}
    typer.echo(to_json(answer) if as_json else words.format(revision))


def _retention(keep_every: int, source: str) -> operations.Retention:
    try:
        return msgspec.convert({"keep_every": keep_every, "source": source}, operations.Retention)
    except msgspec.ValidationError as error:
        raise InvalidValue("retention", f"{error}.") from None


def _draw_verification(found: operations.Verification) -> Group:
    mended, defects = map(Text, found.mended), map(Text, _list_defects(found))
    return Group(*mended, _draw_checks(found.checks), *defects)


def _draw_checks(checks: tuple[operations.Check, ...]) -> Table:
    grid = start_grid("", "check", "what holds", "defects", right={"defects"})
    for each in checks:
        mark = "wrong" if each.defects else "ok"
        cells = (mark, each.name, each.promise, str(each.defects or "-"))
        grid.add_row(*map(escape, cells))
    return grid


def _list_defects(found: operations.Verification) -> Iterator[str]:
    for each in found.checks:
        for defect in each.shown:
            yield f"{each.name}: {defect.where}: {defect.found} {defect.remedy}"
        if more := each.defects - len(each.shown):
            yield f"{each.name}: and {more} more."


def _draw_pruning(found: operations.PruneReport) -> Group:
    counted = {"episodes", "scenes", "bytes"}
    grid = start_grid(
        "campaign", "name", "episodes", "scenes", "bytes", right={"campaign", *counted}
    )
    for each in found.campaigns:
        weight = each.weight
        sums = (f"{weight.episodes:,}", f"{weight.scenes:,}", f"{weight.bytes:,}")
        grid.add_row(str(each.campaign), escape(each.name), *sums)
    in_use = ", ".join(map(str, found.in_use))
    notes = [Text(f"Left alone, since others learn from them: {in_use}.")] if in_use else []
    whole, verb = found.weight, "would lose" if found.is_rehearsal else "lost"
    sentence = (
        f"{whole.episodes:,} episodes {verb} their noise and {whole.scenes:,} scenes: "
        f"{whole.bytes:,} bytes."
    )
    return Group(*[grid] * bool(found.campaigns), *notes, Text(sentence))
