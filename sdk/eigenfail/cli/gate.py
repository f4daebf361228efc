"""`eigenfail gate`: what is new, fixed and still failing under another version of a planner."""

import re
from contextlib import suppress
from pathlib import Path
from typing import Annotated

import typer

from eigenfail.cli.gate_runs import Runner
from eigenfail.cli.gate_tables import gate_page
from eigenfail.cli.interruption import INTERRUPTED
from eigenfail.cli.local_service import Plan
from eigenfail.cli.options import DEFAULT_DATA, AsJson, Data, Workers
from eigenfail.cli.output import show
from eigenfail.cli.planner_code import fingerprint
from eigenfail.cli.run import MaybeUrl, somewhere
from eigenfail.cli.signals import interruptible
from eigenfail.cli.suite import refuse_early
from eigenfail.cli.surroundings import client_at, this_command
from eigenfail.errors import InvalidValue, ServiceError
from eigenfail.gate.junit import to_junit
from eigenfail.gate.report import By, Gate, GateReport
from eigenfail.gate.versions import run_name
from eigenfail.suites import Suite

CLOSED = 1
VERSION = re.compile(r"[\w.+/-]{1,80}")

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
    with (
        interruptible(),
        somewhere(context, suite.members[0].spec, url, Plan(data, 0, workers)) as place,
        client_at(context, place.url) as client,
    ):
        refuse_early(suite, place)
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


def named(baseline: str | None) -> str:
    """The baseline that was named; empty where this run becomes one.

    Raises:
        InvalidValue: the name is empty, as that of a variable that was never set.
    """
    if baseline is not None and not baseline.strip():
        raise InvalidValue("baseline", "is empty.", "Name one, or leave --baseline out.")
    return baseline or ""


def checked(version: str) -> str:
    """The version that was given; empty if none was.

    Raises:
        InvalidValue: it cannot be part of a name.
    """
    if version and not VERSION.fullmatch(version):
        raise InvalidValue(
            "planner-version",
            f"'{version}' is not of letters, digits and any of . _ + / - alone, at most 80.",
            "Give a commit or a tag.",
        )
    return version


def of_this_machine(suite: Suite, url: str | None) -> str:
    """A fingerprint of the planners that are installed here.

    Raises:
        InvalidValue: those that are tested are elsewhere.
    """
    if url:
        raise InvalidValue(
            "planner-version",
            "is not given, and the code of a service elsewhere cannot be seen from here.",
            "Name what is installed there, such as a commit.",
        )
    return fingerprint(suite)


def check_folder(junit: Path | None) -> None:
    """Raises InvalidValue, before anything is run, if no report can be written there."""
    if junit and not junit.parent.is_dir():
        raise InvalidValue("junit", f"There is no folder {junit.parent}.", "Make it first.")


def write(file: Path, content: bytes) -> None:
    """All of it or nothing.

    Raises:
        InvalidValue: it cannot be written.
    """
    draft = file.with_name(f"{file.name}.new")
    try:
        draft.write_bytes(content)
        draft.replace(file)
    except OSError as error:
        with suppress(OSError):
            draft.unlink(missing_ok=True)
        problem = f"{file} cannot be written: {error.strerror}."
        raise InvalidValue("junit", problem, "Name a file in a folder of yours.") from error


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
