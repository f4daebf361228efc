"""`eigenfail gate`: what is new, fixed and still failing under another version of a planner."""

from pathlib import Path
from typing import Annotated

import typer

from eigenfail.cli.gate_files import check_folder, write
from eigenfail.cli.gate_runs import Runner
from eigenfail.cli.gate_tables import gate_page
from eigenfail.cli.gate_versions import checked, named, of_this_machine
from eigenfail.cli.interruption import INTERRUPTED
from eigenfail.cli.options import DEFAULT_DATA, AsJson, Data, Workers
from eigenfail.cli.output import show
from eigenfail.cli.places import MaybeUrl, client_of_suite
from eigenfail.cli.surroundings import this_command
from eigenfail.errors import ServiceError
from eigenfail.gate.found import By
from eigenfail.gate.junit import to_junit
from eigenfail.gate.report import Gate, GateReport
from eigenfail.gate.versions import run_name
from eigenfail.hosting.service import Plan
from eigenfail.suites import Suite

CLOSED = 1

app = typer.Typer(add_completion=False)

SuiteFile = Annotated[
    Path, typer.Argument(metavar="SUITE.toml", help="The suite, with the planners under test.")
]
Baseline = Annotated[
    str | None,
    typer.Option(
        metavar="RUN",
        help="What to judge against: a version that was gated, a suite or its file that was run,"
        " or campaigns such as 1,2,3. Without it, this run becomes one.",
    ),
]
PlannerVersion = Annotated[
    str,
    typer.Option(
        envvar="EIGENFAIL_PLANNER_VERSION",
        show_default="a fingerprint of the code installed here",
        help="Version of the planners under test, such as a commit.",
    ),
]
JudgedBy = Annotated[
    By,
    typer.Option(help="Where noise is the same: judge each episode, or how many fail of all."),
]
Strict = Annotated[
    bool, typer.Option("--strict", help="Failures that were there before close the gate, too.")
]
JUnit = Annotated[
    Path | None, typer.Option("--junit", metavar="FILE", help="Write a report as JUnit XML.")
]


@app.command()
def gate(
    context: typer.Context,
    file: SuiteFile,
    baseline: Baseline = None,
    planner_version: PlannerVersion = "",
    by: JudgedBy = By.EPISODE,
    strict: Strict = False,
    junit: JUnit = None,
    url: MaybeUrl = None,
    data: Data = DEFAULT_DATA,
    workers: Workers = 0,
    as_json: AsJson = False,
) -> None:
    """Judge a new version of a planner by the failures of an earlier one.

    Replays the baseline's known failures and runs its campaigns again, with the planners of the
    suite. Exits with 1 if a failure is new, or cannot be run any more. The same command goes on
    where it stopped. Where it runs is decided as by `eigenfail run`.
    """
    suite = Suite.read(file)
    version = checked(planner_version) or of_this_machine(suite, url)
    run = run_name(suite.name, version)
    against = named(baseline)
    asked = Gate(suite=suite.name, version=version, run=run, baseline=against, strict=strict, by=by)
    check_folder(junit)
    with client_of_suite(context, suite, url, Plan(data, 0, workers)) as (client, place):
        report = judged(Runner(client, place, this_command()), suite, asked)
    if junit:
        write(junit, to_junit(report))
    show(report, as_json, lambda: gate_page(report))
    close(report)


def judged(runner: Runner, suite: Suite, asked: Gate) -> GateReport:
    """What the gate found; Ctrl-C between campaigns says how to go on, and exits with 130."""
    try:
        return runner.run(suite, asked)
    except KeyboardInterrupt:
        typer.echo(f"Interrupted. To go on: {this_command()}", err=True)
        raise typer.Exit(INTERRUPTED) from None


def close(report: GateReport) -> None:
    """Exit with 1 if the gate is closed.

    Raises:
        ServiceError: only because episodes were lost, which says nothing of the planner.
    """
    if report.in_trouble:
        raise ServiceError(
            f"The gate of {report.gate.run} proves nothing: {next(report.problems(), '')}",
            "Look after the workers, then give another --planner-version.",
        )
    if not report.open:
        raise typer.Exit(CLOSED)
