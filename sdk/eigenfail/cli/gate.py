"""`eigenfail gate`: new, fixed and remaining failures of another version of a planner."""

import re
from contextlib import suppress
from hashlib import sha256
from importlib.metadata import distributions
from pathlib import Path
from typing import Annotated, Any

import msgspec
import typer
from typer.core import TyperGroup

from eigenfail.cli.connection import MaybeUrl, connect_for_suite, connect_to, this_command
from eigenfail.cli.gate_runs import Runner
from eigenfail.cli.gate_tables import draw_report, draw_summaries
from eigenfail.cli.options import AsJson, Data, Limit, Url, Workers
from eigenfail.cli.render import INTERRUPTED, first_rows, show
from eigenfail.client import Client
from eigenfail.errors import EigenfailError, InvalidValue, ServiceError
from eigenfail.gate.baselines import name_run
from eigenfail.gate.report import (
    INCONCLUSIVE,
    GateReport,
    GateRun,
    describe_conclusion,
    to_junit,
)
from eigenfail.gate.reruns import JudgedBy
from eigenfail.hosting.folder import DEFAULT_DATA, DEFAULT_URL
from eigenfail.hosting.service import Plan
from eigenfail.suites import Suite
from eigenfail.versions import LENGTH, list_packages, read_package_files


def _check_folder(junit: Path | None) -> None:
    """Raises InvalidValue, before anything is run, if no report can be written there."""
    if junit and not junit.parent.is_dir():
        raise InvalidValue("junit", f"Folder {junit.parent} does not exist.", "Create it first.")


def _write_junit(file: Path, content: bytes) -> None:
    """Write the JUnit report, all of it or nothing.

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


def fingerprint(suite: Suite) -> str:
    """Different where the world that a suite's episodes run in may behave differently.

    Made of all files in the packages of its planners, scenarios and simulators, of the versions of
    all that is installed, and of the planners' settings. Code that lies elsewhere is not seen.

    Raises:
        UnknownName: a plug-in that is not installed here.
        InvalidValue: a package whose code cannot be found.
    """
    digest = sha256()
    for package in sorted({name for each in suite.members for name in list_packages(each.spec)}):
        for name, content in read_package_files(package):
            digest.update(f"{package}/{name}\0{len(content)}\0".encode() + content)
    digest.update("\n".join(_list_installed_packages()).encode())
    settings = [
        (each.name, each.spec.planner, each.spec.planner_settings) for each in suite.members
    ]
    digest.update(msgspec.json.encode(settings, order="sorted"))
    return digest.hexdigest()[:LENGTH]


def _list_installed_packages() -> list[str]:
    """Return all installed packages with their versions."""
    return sorted({f"{each.metadata['Name']}=={each.version}" for each in distributions()})


VERSION = re.compile(r"[\w.+/-]{1,80}")


def _find_baseline_version(baseline: str | None) -> str:
    """The baseline that was named; empty where this run becomes one.

    Raises:
        InvalidValue: the name is empty, as that of a variable that was never set.
    """
    if baseline is not None and not baseline.strip():
        raise InvalidValue("baseline", "is empty.", "Specify a baseline, or omit --baseline.")
    return baseline or ""


def _check_version(version: str) -> str:
    """The version that was given; empty if none was.

    Raises:
        InvalidValue: it cannot be part of a name.
    """
    if version and not VERSION.fullmatch(version):
        raise InvalidValue(
            "planner-version",
            f"'{version}' is not a valid version: use up to 80 letters, digits and . _ + / -.",
            "Give a commit or a tag.",
        )
    return version


def _find_own_version(suite: Suite, url: str | None) -> str:
    """A fingerprint of the planners that are installed here.

    Raises:
        InvalidValue: those that are tested are elsewhere.
    """
    if url:
        raise InvalidValue(
            "planner-version",
            "is not given, and the code of a remote service cannot be read.",
            "Name the installed version, such as a commit.",
        )
    return fingerprint(suite)


CLOSED = 1
RUN = "run"


class GateCommands(TyperGroup):
    """`eigenfail gate`, which runs the gate of a file where no other command is named."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Put the command in front of a file."""
        if args and args[0] not in (*self.commands, *ctx.help_option_names):
            args = [RUN, *args]
        return super().parse_args(ctx, args)


app = typer.Typer(
    cls=GateCommands,
    add_completion=False,
    no_args_is_help=True,
    help="Check a new version of a planner against the failures of an earlier one.\n\n"
    "`eigenfail gate FILE.toml` is short for `eigenfail gate run FILE.toml`.",
)

GateId = Annotated[int, typer.Argument(metavar="ID", min=1, help="Id of the result of a gate.")]

SuiteFile = Annotated[
    Path, typer.Argument(metavar="FILE.toml", help="The suite, with the planners under test.")
]
Baseline = Annotated[
    str | None,
    typer.Option(
        metavar="RUN",
        help="Baseline: a version that was gated, a suite or its file that was run,"
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
ByOption = Annotated[
    JudgedBy,
    typer.Option(help="Where noise is the same: judge single episodes, or the failure rate."),
]
Strict = Annotated[
    bool, typer.Option("--strict", help="Also fail if known failures of the baseline persist.")
]
JUnit = Annotated[
    Path | None, typer.Option("--junit", metavar="FILE", help="Write a report as JUnit XML.")
]


@app.command(RUN)
def run_gate(
    context: typer.Context,
    file: SuiteFile,
    baseline: Baseline = None,
    planner_version: PlannerVersion = "",
    by: ByOption = JudgedBy.EPISODE,
    strict: Strict = False,
    junit: JUnit = None,
    url: MaybeUrl = None,
    data: Data = DEFAULT_DATA,
    workers: Workers = 0,
    as_json: AsJson = False,
) -> None:
    """Check a new version of a planner against the failures of an earlier one.

    Replays the baseline's known failures and runs its campaigns again, with the planners of the
    suite. Exits with 1 if a failure is new, judged as --by says, or an episode errors now; with
    --strict also if a known failure persists. The same command resumes an interrupted gate. Where
    it runs is decided as by `eigenfail run`.
    """
    suite = Suite.read(file)
    version = _check_version(planner_version) or _find_own_version(suite, url)
    run = name_run(suite.name, version)
    against = _find_baseline_version(baseline)
    asked = GateRun(
        suite=suite.name,
        version=version,
        run=run,
        baseline=against,
        strict=strict,
        by=by,
        file=str(file),
    )
    _check_folder(junit)
    with connect_for_suite(context, suite, url, Plan(data, 0, workers)) as (client, place):
        report = _run_and_write(Runner(client, place, this_command()), suite, asked)
        _record_verdict(client, report)
    if junit:
        _write_junit(junit, to_junit(report))
    show(report, as_json, lambda: draw_report(report))
    _exit_by_verdict(report)


def _run_and_write(runner: Runner, suite: Suite, asked: GateRun) -> GateReport:
    """What the gate found; Ctrl-C between campaigns says how to go on, and exits with 130."""
    try:
        return runner.run(suite, asked)
    except KeyboardInterrupt:
        typer.echo(f"Interrupted. To continue, run: {this_command()}", err=True)
        raise typer.Exit(INTERRUPTED) from None


def _record_verdict(client: Client, report: GateReport) -> None:
    """Report the verdict to the service, for its pages, its event log and webhooks.

    The verdict of this command is the same where the service does not take it.
    """
    if report.in_trouble:
        return
    try:
        client.gates.record(report)
    except EigenfailError as error:
        typer.echo(f"The service did not record the verdict: {error}", err=True)


def _exit_by_verdict(report: GateReport) -> None:
    """Exit with 1 if the gate is closed.

    Raises:
        ServiceError: only because episodes were lost or may hide a failure, which says nothing of
            the planner.
    """
    if report.state == INCONCLUSIVE:
        raise ServiceError(
            describe_conclusion(report),
            "Correct what the episodes raised, or give unresolved ones a longer horizon; then use "
            "a different --planner-version.",
        )
    if report.in_trouble:
        raise ServiceError(
            f"The gate of {report.gate.run} is inconclusive: {next(report.problems(), '')}",
            "Check the workers, then use a different --planner-version.",
        )
    if not report.open:
        raise typer.Exit(CLOSED)


@app.command("list")
def list_gates(
    context: typer.Context,
    url: Url = DEFAULT_URL,
    limit: Limit = 50,
    as_json: AsJson = False,
) -> None:
    """List the results of gates, newest first."""
    with connect_to(context, url) as client:
        first_rows(client.gates.list(), limit, draw_summaries).print(as_json)


@app.command("show")
def show_gate(
    context: typer.Context, gate: GateId, url: Url = DEFAULT_URL, as_json: AsJson = False
) -> None:
    """Show the result of a gate, as the gate printed it."""
    with connect_to(context, url) as client:
        found = client.gates.get(gate)
    show(found, as_json, lambda: draw_report(found.report))
