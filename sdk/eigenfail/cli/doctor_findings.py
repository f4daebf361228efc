"""What `eigenfail doctor` finds: programs, plug-ins, a data folder, a service, a database."""

import sys
from collections.abc import Iterator, Sequence
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import msgspec
import typer
from rich.markup import escape
from rich.table import Table

from eigenfail import plugins
from eigenfail.cli.db_options import verified
from eigenfail.cli.surroundings import client_at
from eigenfail.cli.tables import table
from eigenfail.client import Client
from eigenfail.errors import EigenfailError, InvalidValue, StoreUnavailable
from eigenfail.hosting.folder import DataFolder
from eigenfail.values import CampaignState
from eigenfail.values.upkeep import Verification
from eigenfail.values.worker import Presence

PACKAGES = ("numpy", "msgspec", "pyzmq", "ray", "torch", "fastapi", "sqlalchemy", "highway-env")
GROUPS = (plugins.SCENARIOS, plugins.PLANNERS, plugins.SIMULATORS, plugins.METHODS)
WORKING = (CampaignState.QUEUED, CampaignState.RUNNING)
NOBODY = (
    "do the services run (python -m eigenfail_services), and what does their log say? "
    "By hand: eigenfail worker --connect ADDRESS"
)


class Finding(msgspec.Struct, frozen=True):
    """One thing looked at; only what is `wrong` must be put right."""

    what: str
    found: str
    wrong: bool = False
    remedy: str = ""


def versions() -> Iterator[Finding]:
    """What is installed, and where."""
    yield Finding("eigenfail", version("eigenfail"))
    yield Finding("python", f"{sys.version.split()[0]} at {sys.executable}")
    for package in PACKAGES:
        try:
            yield Finding(package, version(package))
        except PackageNotFoundError:
            remedy = "needed to run the service here: pip install 'eigenfail[server,worker]'"
            yield Finding(package, "not installed", remedy=remedy)


def plugin_findings() -> Iterator[Finding]:
    """Which plug-ins there are, by group, and whether each can be loaded."""
    for group in GROUPS:
        yield Finding(group, ", ".join(plugins.names(group)) or "none")
        yield from broken(group)


def broken(group: str) -> Iterator[Finding]:
    """Plug-ins that are registered and cannot be loaded."""
    for name in plugins.names(group):
        try:
            plugins.load(group, name)
        except InvalidValue as error:
            yield Finding(f"{group}: {name}", error.problem, wrong=True)


def folder_finding(data: Path) -> Finding:
    """Whether the data folder can be written, and who runs on it."""
    folder = DataFolder(data)
    if not folder.is_writable():
        return Finding("data folder", f"{folder.path} cannot be written", True, "--data elsewhere")
    return Finding("data folder", f"{folder.path}{folder.where()}")


def service_findings(context: typer.Context, url: str) -> Iterator[Finding]:
    """Whether a service answers, and is well, and who works for it; none has to."""
    what = f"service {url}"
    with client_at(context, url) as client:
        trouble = client.trouble()
        if trouble is None:
            yield Finding(what, "answers")
            yield workers_finding(client)
            yield from stranded_findings(client)
        elif isinstance(trouble, StoreUnavailable):
            yield Finding(what, trouble.problem, True, trouble.remedy)
        else:
            yield Finding(what, "no answer", remedy="start one: eigenfail up")


def workers_finding(client: Client) -> Finding:
    """Who is connected; that nobody is matters once there is work."""
    try:
        here = client.present_workers()
        waits = any(any(client.campaigns.list(state)) for state in WORKING)
        said = "" if here else client.staffing().said
    except EigenfailError as error:
        return Finding("workers", error.problem, remedy=error.remedy)
    if here:
        return Finding("workers", f"{len(here)} connected{of_versions(here)}")
    told = "none is connected" + (", and campaigns wait" if waits else "")
    return Finding("workers", f"{told}. {said}" if said else told, waits, NOBODY)


def stranded_findings(client: Client) -> Iterator[Finding]:
    """Campaigns that none of those who are connected can run."""
    try:
        stranded = client.staffing().stranded
    except EigenfailError:
        return
    yield from (Finding(f"campaign {each.campaign}", each.message, True) for each in stranded)


def of_versions(workers: Sequence[Presence]) -> str:
    """Of which releases they are, where they differ."""
    found = sorted({worker.versions.get("eigenfail", "unknown") for worker in workers})
    return f", of eigenfail {' and '.join(found)}" if len(found) > 1 else ""


def database_findings(database: str | None, replay: int, repair: bool) -> Iterator[Finding]:
    """What was mended, and what is wrong, in the database that is named, if one is.

    Raises:
        InvalidValue: none is named, and there is something to do in it.
    """
    if database is None:
        if replay or repair:
            raise InvalidValue("database", "None is named.", "Give --database, too.")
        return
    try:
        found = verified(database, replay, repair)
    except EigenfailError as error:
        yield Finding("database", error.problem, wrong=True, remedy=error.remedy)
        return
    yield from verdicts(found)


def verdicts(found: Verification) -> Iterator[Finding]:
    """What came of a database's check: in all, what was mended, and check by check."""
    told = f"{found.database}: {found.defects or 'no'} defects"
    remedy = "eigenfail db verify tells them; --repair mends what is safe" if found.defects else ""
    yield Finding("database", told, bool(found.defects), remedy)
    yield from (Finding("database: mended", sentence) for sentence in found.mended)
    for check in found.checks:
        held = f"{check.promise} Defects: {check.defects or 'none'}."
        yield Finding(f"database: {check.name}", held, bool(check.defects))


def finding_table(findings: list[Finding]) -> Table:
    """What was found, what is wrong marked as such."""
    grid = table("", "what", "found", "remedy")
    for finding in findings:
        mark = "wrong" if finding.wrong else ("-" if finding.remedy else "ok")
        cells = (mark, finding.what, finding.found, finding.remedy)
        grid.add_row(*(escape(cell) for cell in cells))
    return grid
