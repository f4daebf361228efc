"""`eigenfail doctor`: what is installed, what answers and what is missing."""

import sys
from collections.abc import Iterator, Sequence
from importlib.metadata import PackageNotFoundError, version
from typing import Annotated

import msgspec
import typer
from rich.markup import escape
from rich.table import Table

from eigenfail import plugins, side_process
from eigenfail.bridges import check_address
from eigenfail.cli import completion
from eigenfail.cli.checkups import Checked, Verdict, check_table, check_up
from eigenfail.cli.db_options import Database, said
from eigenfail.cli.options import DEFAULT_DATA, DEFAULT_URL, AsJson, Data, Url
from eigenfail.cli.output import show
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
TROUBLE = 3
BROKEN = 1
PLACE = "NAME|module:Class"
BRIDGE_CHECK = "eigenfail_workers.bridge"
BRIDGE_PATIENCE_S = 900.0

app = typer.Typer(add_completion=False)


PlannerPlugin = Annotated[
    str | None,
    typer.Option(
        "--planner", metavar=PLACE, help="Check this planner.", autocompletion=completion.planners
    ),
]
ScenarioPlugin = Annotated[
    str | None,
    typer.Option(
        "--scenario",
        metavar=PLACE,
        help="Check this scenario.",
        autocompletion=completion.scenarios,
    ),
]
BridgeAddress = Annotated[
    str | None,
    typer.Option("--bridge", metavar="ADDRESS", help="Check the bridge at this address."),
]


class Finding(msgspec.Struct, frozen=True):
    """One thing looked at; only what is `wrong` must be put right."""

    what: str
    found: str
    wrong: bool = False
    remedy: str = ""


WORKING = (CampaignState.QUEUED, CampaignState.RUNNING)
NOBODY = (
    "do the services run (python -m eigenfail_services), and what does their log say? "
    "By hand: eigenfail worker --connect ADDRESS"
)


@app.command()
def doctor(
    context: typer.Context,
    url: Url = DEFAULT_URL,
    data: Data = DEFAULT_DATA,
    database: Database = None,
    planner: PlannerPlugin = None,
    scenario: ScenarioPlugin = None,
    bridge: BridgeAddress = None,
    as_json: AsJson = False,
) -> None:
    """Say what is installed, what answers and what is missing.

    Exits with 3 if something is wrong. With --database: what `eigenfail db verify` finds, too. With
    --planner or --scenario: check that plug-in alone; exits with 1 if it breaks its contract. With
    --bridge: run episodes on that bridge, and say whether it keeps to the protocol.
    """
    if bridge:
        examine_bridge(bridge, as_json)
        return
    if planner or scenario:
        examine(planner, scenario, as_json)
        return
    findings = [
        *versions(),
        *plugin_findings(),
        folder_finding(data),
        *service_findings(context, url),
        *database_findings(database),
    ]
    show(findings, as_json, lambda: finding_table(findings))
    if any(finding.wrong for finding in findings):
        raise typer.Exit(TROUBLE)


def examine(planner: str | None, scenario: str | None, as_json: bool) -> None:
    """Hold plug-ins against their contracts."""
    checks = check_up(planner, scenario)
    show(checks, as_json, lambda: check_table(checks))
    if any(check.verdict is Verdict.BROKEN for check in checks):
        raise typer.Exit(BROKEN)


def examine_bridge(address: str, as_json: bool) -> None:
    """Hold a bridge against its protocol, in a process that has what it takes to talk to it."""
    answer = side_process.ask(BRIDGE_CHECK, check_address(address).encode(), BRIDGE_PATIENCE_S)
    checks = msgspec.json.decode(answer, type=list[Checked])
    show(checks, as_json, lambda: check_table(checks))
    if any(check.verdict is Verdict.BROKEN for check in checks):
        raise typer.Exit(TROUBLE)


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


def folder_finding(data: Data) -> Finding:
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


def of_versions(workers: Sequence[Presence]) -> str:
    """Of which releases they are, where they differ."""
    found = sorted({worker.versions.get("eigenfail", "unknown") for worker in workers})
    return f", of eigenfail {' and '.join(found)}" if len(found) > 1 else ""


def database_findings(database: str | None) -> Iterator[Finding]:
    """What is wrong in the database that is named, if one is."""
    if database is None:
        return
    try:
        found = said(Verification, "verify", database)
    except EigenfailError as error:
        yield Finding("database", error.problem, wrong=True)
        return
    told = f"{found.database}: {found.defects or 'no'} defects"
    remedy = "eigenfail db verify tells them" if found.defects else ""
    yield Finding("database", told, bool(found.defects), remedy)


def finding_table(findings: list[Finding]) -> Table:
    """What was found, what is wrong marked as such."""
    grid = table("", "what", "found", "remedy")
    for finding in findings:
        mark = "wrong" if finding.wrong else ("-" if finding.remedy else "ok")
        cells = (mark, finding.what, finding.found, finding.remedy)
        grid.add_row(*(escape(cell) for cell in cells))
    return grid
