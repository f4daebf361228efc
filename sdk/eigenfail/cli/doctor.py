"""`eigenfail doctor`: what is installed, what answers and what is missing."""

from collections.abc import Mapping
from typing import Annotated

import msgspec
import typer

from eigenfail import side_process
from eigenfail.bridges import check_address
from eigenfail.cli import completion
from eigenfail.cli.checkups import Checked, Verdict, check_table, check_up
from eigenfail.cli.db_options import Database, Repair, Replay
from eigenfail.cli.doctor_findings import (
    database_findings,
    finding_table,
    folder_finding,
    plugin_findings,
    service_findings,
    versions,
)
from eigenfail.cli.options import DEFAULT_DATA, DEFAULT_URL, AsJson, Data, Url
from eigenfail.cli.output import show
from eigenfail.errors import InvalidValue

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


@app.command()
def doctor(
    context: typer.Context,
    url: Url = DEFAULT_URL,
    data: Data = DEFAULT_DATA,
    database: Database = None,
    replay: Replay = 0,
    repair: Repair = False,
    planner: PlannerPlugin = None,
    scenario: ScenarioPlugin = None,
    bridge: BridgeAddress = None,
    as_json: AsJson = False,
) -> None:
    """Say what is installed, what answers and what is missing.

    Exits with 3 if something is wrong. With --database: what `eigenfail db verify` finds, too, and
    what it mends with --repair. With --planner or --scenario: check that plug-in alone; exits with
    1 if it breaks its contract. With --bridge: run episodes on that bridge, and say whether it
    keeps to the protocol.
    """
    of_database: dict[str, object] = {"--replay": replay, "--repair": repair}
    if bridge:
        refuse_besides("--bridge", {"--planner": planner, "--scenario": scenario, **of_database})
        examine_bridge(bridge, as_json)
        return
    if planner or scenario:
        refuse_besides("--planner" if planner else "--scenario", of_database)
        examine(planner, scenario, as_json)
        return
    findings = [
        *versions(),
        *plugin_findings(),
        folder_finding(data),
        *service_findings(context, url),
        *database_findings(database, replay, repair),
    ]
    show(findings, as_json, lambda: finding_table(findings))
    if any(finding.wrong for finding in findings):
        raise typer.Exit(TROUBLE)


def refuse_besides(alone: str, others: Mapping[str, object]) -> None:
    """Refuse what nothing would come of beside an option that is looked at alone.

    Raises:
        InvalidValue: there is such an option.
    """
    for name, given in others.items():
        if given:
            problem = f"does nothing beside {alone}, which is checked alone."
            raise InvalidValue(name, problem, "Run the two one after the other.")


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
