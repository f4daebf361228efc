"""`eigenfail db`: create, upgrade, check, back up, restore and thin out a database."""

from collections.abc import Iterable, Iterator
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import Annotated

import msgspec
import typer

from eigenfail.cli.answers import prints_answer
from eigenfail.cli.options import Data, Database, Replay
from eigenfail.cli.render import CommandResult
from eigenfail.errors import InvalidValue
from eigenfail.hosting.folder import DEFAULT_DATA, DataFolder
from eigenfail.hosting.service import require_installed
from eigenfail.presentation import tables
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


@contextmanager
def name_database(database: Database = None, data: Data = DEFAULT_DATA) -> Iterator[str]:
    """Yield the URL of a database."""
    yield database or DataFolder(data).database


@contextmanager
def claim_database(database: Database = None, data: Data = DEFAULT_DATA) -> Iterator[str]:
    """Yield the URL of a database that no service of the data folder uses meanwhile."""
    # Other clients of a database that is named on the command line are the user's business.
    with nullcontext() if database else DataFolder(data).claimed():
        yield database or DataFolder(data).database


@app.command()
@prints_answer("Upgrading the schema", opened_by=name_database)
def upgrade(url: str) -> CommandResult:
    """Create the schema, or upgrade it to this release."""
    from eigenfail_services.store import migrate

    migrate.upgrade(url)
    words = "The database's schema is at revision {}, which is this program's."
    return _show_revision("upgrade", url, words)


@app.command()
@prints_answer(opened_by=name_database)
def current(url: str) -> CommandResult:
    """Print the schema's revision."""
    return _show_revision("current", url, "{}")


@app.command()
@prints_answer(opened_by=name_database)
def check(url: str) -> CommandResult:
    """Check whether the schema is that of this release; exit with 3 if not."""
    from eigenfail_services.store.store import open_store

    open_store(url, migrate=False).close()
    return _show_revision("check", url, "The database's schema is this program's: revision {}.")


@app.command()
@prints_answer("Verifying the database", opened_by=name_database)
def verify(url: str, replay: Replay = 0) -> CommandResult:
    """Verify the contents of a database; exit with 1 if there are defects.

    A service may use it meanwhile.
    """
    from eigenfail_services.upkeep import verify as verification

    found = verification.verify(url, replay)
    return CommandResult(
        found,
        _tabulate_checks(found.checks),
        *_list_defects(found),
        exit_code=DEFECTS_FOUND if found.defects else 0,
    )


@app.command()
@prints_answer(opened_by=name_database)
def backup(url: str, file: File, force: Force = False) -> CommandResult:
    """Back up a SQLite database to a file; a running service may use it meanwhile.

    The file appears once it is complete and checked. For PostgreSQL, use pg_dump.
    """
    from eigenfail_services.upkeep import backup as backups

    with announce(f"Writing {file}"):
        made = backups.backup(url, file, force=force)
    words = f"{made.file} holds all of {made.database} ({made.bytes} bytes)."
    return CommandResult(made, words)


@app.command()
@prints_answer(opened_by=claim_database)
def restore(url: str, file: File, force: Force = False) -> CommandResult:
    """Restore a backup into an empty database, or with --force over an existing one.

    Either everything is restored or nothing changes. Stop all services of the database first.
    For PostgreSQL, use pg_restore.
    """
    from eigenfail_services.upkeep import backup as backups

    with announce(f"Restoring {file}"):
        restored = backups.restore(url, file, force=force)
    words = f"{restored.database} holds what {restored.file} held (schema {restored.revision})."
    return CommandResult(restored, words)


@app.command()
@prints_answer(opened_by=name_database)
def prune(
    url: str,
    keep_every: KeepEvery = operations.KEEP_EVERY,
    source: Source = operations.DRAWN_AGAIN,
    older_than: OlderThan = 0.0,
    campaigns: Campaigns = [],  # noqa: B006 - typer takes no tuple of any length
    dry_run: DryRun = False,
) -> CommandResult:
    """Remove noise and scenes of safe episodes in campaigns that have ended.

    Rows and failures stay, and with them counts, rates, measures and costs. A running service
    may use the database meanwhile. Freed space is reused; `eigenfail db vacuum` returns it to
    the disk.
    """
    from eigenfail_services.upkeep import pruning

    act = pruning.rehearse if dry_run else pruning.prune
    which = pruning.PruneSelection(tuple(campaigns), older_than)
    kept = _retention(keep_every, source)
    with announce("Counting what would be removed" if dry_run else "Removing noise and scenes"):
        found = act(url, kept, which)
    return CommandResult(found, *_describe_pruning(found))


@app.command()
@prints_answer("Returning free space to the disk", opened_by=claim_database)
def vacuum(url: str) -> CommandResult:
    """Return free space inside a SQLite database to the disk.

    SQLite rewrites the file: stop the service first, and leave room for a second copy.
    For PostgreSQL, use VACUUM.
    """
    from eigenfail_services.upkeep import backup as backups

    done = backups.vacuum(url)
    freed = max(0, done.bytes_before - done.bytes_after)
    words = f"{done.database} takes {done.bytes_after:,} bytes; {freed:,} were given back."
    return CommandResult(done, words)


def _show_revision(action: str, url: str, words: str) -> CommandResult:
    from eigenfail_services.store import migrate

    revision = migrate.read_version(url) or "empty"
    return CommandResult({"action": action, "said": revision}, words.format(revision))


def _retention(keep_every: int, source: str) -> operations.Retention:
    try:
        return msgspec.convert({"keep_every": keep_every, "source": source}, operations.Retention)
    except msgspec.ValidationError as error:
        raise InvalidValue("retention", f"{error}.") from None


def _tabulate_checks(checks: Iterable[operations.Check]) -> tables.Table:
    return tables.tabulate(
        "Checks",
        checks,
        tables.read_text("", lambda check: "wrong" if check.defects else "ok"),
        tables.read_text("Check", "name"),
        tables.read_text("What holds", "promise"),
        tables.read_number("Defects", lambda check: check.defects or "-"),
    )


def _list_defects(found: operations.Verification) -> Iterator[str]:
    for each in found.checks:
        for defect in each.shown:
            yield f"{each.name}: {defect.where}: {defect.found} {defect.remedy}"
        if more := each.defects - len(each.shown):
            yield f"{each.name}: and {more} more."


def _describe_pruning(found: operations.PruneReport) -> Iterator[tables.Block]:
    if found.campaigns:
        yield tables.tabulate(
            "Pruning",
            found.campaigns,
            tables.read_number("Campaign", lambda each: str(each.campaign)),
            tables.read_text("Name", "name"),
            tables.read_number("Episodes", "weight.episodes"),
            tables.read_number("Scenes", "weight.scenes"),
            tables.read_number("Bytes", "weight.bytes"),
        )
    if found.in_use:
        yield f"Left alone, since others learn from them: {', '.join(map(str, found.in_use))}."
    whole, verb = found.weight, "would lose" if found.is_rehearsal else "lost"
    yield (
        f"{whole.episodes:,} episodes {verb} their noise and {whole.scenes:,} scenes: "
        f"{whole.bytes:,} bytes."
    )
