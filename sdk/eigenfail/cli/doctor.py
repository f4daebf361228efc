"""`eigenfail doctor`: installed packages, services that answer, and missing parts."""

import sys
from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from importlib.machinery import EXTENSION_SUFFIXES
from importlib.metadata import PackageNotFoundError, version
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated, Any

import msgspec
import typer

from eigenfail import bridges, plugins
from eigenfail.cli import completion
from eigenfail.cli.connection import connect_to
from eigenfail.cli.options import AsJson, Data, Database, Replay, Url
from eigenfail.cli.plugin_checks import (
    CONTRACTS,
    CheckResult,
    CheckVerdict,
    check_plugins,
    tabulate_checks,
)
from eigenfail.cli.render import show
from eigenfail.cli.specs import ask_about_bridges, read_spec
from eigenfail.client import Client
from eigenfail.errors import EigenfailError, InvalidValue, ServiceUnreachable, StoreUnavailable
from eigenfail.hosting.folder import DEFAULT_DATA, DEFAULT_URL, DataFolder
from eigenfail.hosting.service import load_database_tool
from eigenfail.methods import find_narrow_campaigns
from eigenfail.presentation import tables
from eigenfail.progress import announce
from eigenfail.values.campaign import CampaignState
from eigenfail.values.operations import Verification

PACKAGES = ("numpy", "msgspec", "pyzmq", "ray", "torch", "fastapi", "sqlalchemy", "highway-env")
GROUPS = (plugins.SCENARIOS, plugins.PLANNERS, plugins.SIMULATORS, plugins.METHODS)
WORKING = (CampaignState.QUEUED, CampaignState.RUNNING)
COMPILE = "python -m eigenfail_workers.compiler"
NO_WORKER = (
    "do the services run (python -m eigenfail_services), and what does their log say? "
    "To start a worker: eigenfail worker --connect ADDRESS"
)


class Finding(msgspec.Struct, frozen=True):
    """One check of the doctor; only findings with `wrong` need action."""

    what: str
    found: str
    wrong: bool = False
    remedy: str = ""


def list_versions() -> Iterator[Finding]:
    """Return the installed versions, and their location."""
    yield Finding("eigenfail", version("eigenfail"))
    yield Finding("python", f"{sys.version.split()[0]} at {sys.executable}")
    for package in PACKAGES:
        try:
            yield Finding(package, version(package))
        except PackageNotFoundError:
            remedy = "needed to run the service here: pip install '.[server,worker]'"
            yield Finding(package, "not installed", remedy=remedy)


def list_plugins() -> Iterator[Finding]:
    """Which plug-ins there are, by group, those that cannot be loaded, and groups nobody reads."""
    # Extensions of the API are left out by a service that cannot load them: its log says so, and
    # their pages are missing; the same holds for background tasks. Where no service can run, they
    # cannot be loaded, and need not be.
    of_service = (plugins.ROUTES, plugins.TASKS, plugins.TABLES) if find_spec("fastapi") else ()
    for group in (*GROUPS, *of_service, plugins.EXPORTS, plugins.NOTEBOOKS):
        yield Finding(group, ", ".join(plugins.names(group)) or "none")
        for name in plugins.names(group):
            try:
                plugins.load(group, name)
            except EigenfailError as error:
                yield Finding(f"{group}: {name}", error.problem, True, error.remedy)
    for group, meant in plugins.list_misspelt_groups().items():
        found = "no such group of entry points: its plug-ins are ignored"
        yield Finding(group, found, True, f"in their package, write {meant}")


def describe_episode_loop() -> Iterator[Finding]:
    """How the built-in simulators run here; nothing if they are not installed."""
    try:
        simulator = plugins.load(plugins.SIMULATORS, "point_mass")
    except EigenfailError:
        return
    file = str(sys.modules[simulator.__module__].__file__)
    if file.endswith(tuple(EXTENSION_SUFFIXES)):
        yield Finding("episode loop", "compiled")
    else:
        yield Finding("episode loop", "interpreted", remedy=f"to compile it: {COMPILE}")


def check_data_folder(data: Path) -> Finding:
    """Whether the data folder can be written, and who runs on it."""
    folder = DataFolder(data)
    if not folder.is_writable():
        return Finding("data folder", f"{folder.path} cannot be written", True, "--data elsewhere")
    return Finding("data folder", f"{folder.path}{folder.where()}")


def check_service(context: typer.Context, url: str) -> Iterator[Finding]:
    """Whether a service answers, and is well, and who works for it; none has to."""
    try:
        connection = connect_to(context, url)
    except ServiceUnreachable as error:
        yield Finding("service", error.problem, remedy=error.remedy)
        return
    with connection as client:
        what = f"service {client.url}"
        trouble = client.trouble()
        if trouble is None:
            yield Finding(what, "answers")
            yield check_workers(client)
            yield from list_troubled_campaigns(client)
        elif isinstance(trouble, StoreUnavailable):
            yield Finding(what, trouble.problem, True, trouble.remedy)
        else:
            yield Finding(what, "no answer", remedy="start one: eigenfail up")


def check_workers(client: Client) -> Finding:
    """Check the connected workers; having none is wrong only if work is waiting."""
    try:
        here = client.present_workers()
        waits = any(any(client.campaigns.list(state)) for state in WORKING)
        said = "" if here else client.staffing().said
    except EigenfailError as error:
        return Finding("workers", error.problem, remedy=error.remedy)
    if here:
        releases = sorted({each.versions.get("eigenfail", "unknown") for each in here})
        differing = f", of eigenfail {' and '.join(releases)}" if len(releases) > 1 else ""
        return Finding("workers", f"{len(here)} connected{differing}")
    state = "no workers are connected" + (", and campaigns are waiting" if waits else "")
    return Finding("workers", f"{state}. {said}" if said else state, waits, NO_WORKER)


def list_troubled_campaigns(client: Client) -> Iterator[Finding]:
    """Campaigns that no connected worker can run, and those that leave workers idle."""
    # A service that fails here has said so at the check of the workers.
    with suppress(EigenfailError):
        for event in client.staffing().stranded:
            yield Finding(f"campaign {event.campaign}", event.message, True)
        workers = len(client.present_workers())
        running = list(client.campaigns.list(CampaignState.RUNNING))
        for each in find_narrow_campaigns(running, workers):
            yield Finding(f"campaign {each.campaign}", each.found, remedy=each.remedy)


def check_database(database: str | None, replay: int) -> Iterator[Finding]:
    """Check the named database, if any: its defects.

    Raises:
        InvalidValue: none is named, and there is something to do in it.
    """
    if database is None:
        if replay:
            raise InvalidValue("database", "No database is specified.", "Give --database, too.")
        return
    try:
        with announce("Verifying the database"):
            found: Verification = load_database_tool("verify")(database, replay)
    except EigenfailError as error:
        yield Finding("database", error.problem, wrong=True, remedy=error.remedy)
        return
    state = f"{found.database}: {found.defects or 'no'} defects"
    remedy = "eigenfail db verify lists them; restore a backup" if found.defects else ""
    yield Finding("database", state, bool(found.defects), remedy)
    for check in found.checks:
        held = f"{check.promise} Defects: {check.defects or 'none'}."
        yield Finding(f"database: {check.name}", held, bool(check.defects))


def _tabulate_findings(findings: Iterable[Finding]) -> tables.Table:
    """Return the table of findings, with wrong ones marked."""
    return tables.tabulate(
        "Findings",
        findings,
        tables.read_text("", _mark_finding),
        tables.read_text("What", "what"),
        tables.read_text("Found", "found"),
        tables.read_text("Remedy", "remedy"),
    )


def _mark_finding(finding: Finding) -> str:
    if finding.wrong:
        return "wrong"
    return "-" if finding.remedy else "ok"


TROUBLE = 3
BROKEN = 1
PLACE = "NAME|module:Class"

app = typer.Typer(add_completion=False)


def _make_option(kind: str) -> Any:
    names = completion.complete_plugins(CONTRACTS[kind].group)
    return typer.Option(metavar=PLACE, help=f"Check this {kind}.", autocompletion=names)


BridgeAddress = Annotated[
    str | None,
    typer.Option("--bridge", metavar="ADDRESS", help="Check the bridge at this address."),
]
BridgeCampaign = Annotated[
    Path | None,
    typer.Option(
        "--campaign",
        metavar="FILE.toml",
        help="Only run one episode of this campaign on the bridge.",
    ),
]
GoldenFolder = Annotated[
    Path | None,
    typer.Option(
        "--golden",
        metavar="FOLDER",
        help="Write the messages of the bridge protocol to this folder.",
    ),
]


@app.command()
def doctor(
    context: typer.Context,
    url: Url = DEFAULT_URL,
    data: Data = DEFAULT_DATA,
    database: Database = None,
    replay: Replay = 0,
    planner: Annotated[str | None, _make_option("planner")] = None,
    scenario: Annotated[str | None, _make_option("scenario")] = None,
    method: Annotated[str | None, _make_option("method")] = None,
    bridge: BridgeAddress = None,
    campaign: BridgeCampaign = None,
    golden: GoldenFolder = None,
    as_json: AsJson = False,
) -> None:
    """Check the installation, the service and the database.

    Exits with 3 if something is wrong. --database also runs `eigenfail db verify`. --planner,
    --scenario or --method checks only that plug-in, and exits with 1 if it breaks its contract.
    --bridge runs episodes on that bridge, and checks that it keeps to the protocol. With --campaign
    it only runs an episode of that campaign. --golden writes one file for each kind of message
    between worker and bridge, as bytes and as JSON, and checks nothing.
    """
    of_database: dict[str, object] = {"--replay": replay}
    asked = {"planner": planner, "scenario": scenario, "method": method}
    of_plugins: dict[str, object] = {f"--{kind}": place for kind, place in asked.items()}
    if golden:
        of_bridge: dict[str, object] = {"--bridge": bridge, "--campaign": campaign}
        _refuse_besides("--golden", {**of_bridge, **of_plugins, **of_database})
        _write_golden_messages(golden, as_json)
        return
    # Each of these looks at one thing only, and has an exit code of its own.
    if bridge:
        _refuse_besides("--bridge", {**of_plugins, **of_database})
        _check_bridge(bridge, campaign, as_json)
        return
    if campaign:
        raise InvalidValue("--campaign", "needs a bridge.", "Give its address with --bridge.")
    if given := [kind for kind, place in asked.items() if place]:
        _refuse_besides(f"--{given[0]}", of_database)
        with announce(f"Checking {' and '.join(filter(None, asked.values()))}"):
            checks = check_plugins(asked)
        _show_checks(checks, as_json, BROKEN)
        return
    findings = [
        *list_versions(),
        *list_plugins(),
        *describe_episode_loop(),
        check_data_folder(data),
        *check_service(context, url),
        *check_database(database, replay),
    ]
    show(findings, as_json, _tabulate_findings(findings))
    if any(finding.wrong for finding in findings):
        raise typer.Exit(TROUBLE)


def _refuse_besides(alone: str, others: Mapping[str, object]) -> None:
    """Refuse options that have no effect in combination with another one.

    Raises:
        InvalidValue: there is such an option.
    """
    for name, given in others.items():
        if given:
            problem = f"cannot be combined with {alone}."
            raise InvalidValue(name, problem, "Run two separate commands.")


def _show_checks(checks: list[CheckResult], as_json: bool, exit_code: int) -> None:
    """Print checks, and end with an exit code if a contract is broken."""
    show(checks, as_json, tabulate_checks(checks))
    if any(check.verdict is CheckVerdict.BROKEN for check in checks):
        raise typer.Exit(exit_code)


def _check_bridge(address: str, campaign: Path | None, as_json: bool) -> None:
    """Hold a bridge against its protocol, in a process that has what it takes to talk to it."""
    spec = None if campaign is None else read_spec(campaign)
    if spec is not None and spec.simulator != bridges.SIMULATOR:
        problem = f"the campaign runs on '{spec.simulator}', and on no bridge."
        raise InvalidValue("simulator", problem, f'Write simulator = "{bridges.SIMULATOR}".')
    with announce(f"Checking the bridge at {address}"):
        answer = ask_about_bridges(bridges.BridgeCheck(bridges.check_address(address), spec))
    _show_checks(msgspec.json.decode(answer, type=list[CheckResult]), as_json, TROUBLE)


def _write_golden_messages(folder: Path, as_json: bool) -> None:
    """Write each golden message as bytes, and as JSON for people."""
    messages = msgspec.json.decode(
        ask_about_bridges(bridges.GoldenMessages()), type=dict[str, bytes]
    )
    folder.mkdir(parents=True, exist_ok=True)
    for name, data in messages.items():
        text = msgspec.json.format(msgspec.json.encode(msgspec.msgpack.decode(data)))
        (folder / f"{name}.msgpack").write_bytes(data)
        (folder / f"{name}.json").write_bytes(text + b"\n")
    said = f"Wrote {len(messages)} messages to {folder}, each as .msgpack and as .json."
    show(sorted(messages), as_json, said)
