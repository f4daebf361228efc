"""`eigenfail gate`: new, fixed and remaining failures of another version of a planner."""

import re
from collections.abc import Iterable, Iterator
from contextlib import suppress
from hashlib import sha256
from importlib.metadata import distributions
from pathlib import Path
from typing import Annotated, Any

import msgspec
import typer
from typer.core import TyperGroup

from eigenfail.cli.answers import prints_answer
from eigenfail.cli.connection import MaybeUrl, connect_for_suite, this_command
from eigenfail.cli.gate_runs import Runner
from eigenfail.cli.options import AsJson, Data, Limit, Workers
from eigenfail.cli.render import INTERRUPTED, CommandResult, first_rows, show
from eigenfail.client import Client
from eigenfail.errors import EigenfailError, InvalidValue, ServiceError
from eigenfail.gate.baselines import name_run
from eigenfail.gate.report import (
    INCONCLUSIVE,
    GateReport,
    GateRun,
    describe_conclusion,
    list_conclusions,
    to_junit,
)
from eigenfail.gate.reruns import GateFinding, JudgedBy, Rerun
from eigenfail.gate.results import GateSummary
from eigenfail.gate.verdicts import CLOSING, GateVerdict, join_counts
from eigenfail.hosting.folder import DEFAULT_DATA
from eigenfail.hosting.service import Plan
from eigenfail.methods import traits_of
from eigenfail.presentation import tables
from eigenfail.presentation.campaigns import ID
from eigenfail.suites import Suite
from eigenfail.versions import LENGTH, list_packages, read_package_files


def _write_junit(file: Path, content: bytes) -> None:
    """Write the JUnit report, all of it or nothing.

    Raises:
        InvalidValue: it cannot be written.
    """
    # Written beside it, then renamed: a pipeline that reads the file while it is written, or after
    # the disk was full, would take half a report for all of it.
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
    # Sorted, since the order of files and packages on a disk is that of their installation.
    for package in sorted({name for each in suite.members for name in list_packages(each.spec)}):
        for name, content in read_package_files(package):
            digest.update(f"{package}/{name}\0{len(content)}\0".encode() + content)
    installed = {f"{each.metadata['Name']}=={each.version}" for each in distributions()}
    digest.update("\n".join(sorted(installed)).encode())
    settings = [
        (each.name, each.spec.planner, each.spec.planner_settings) for each in suite.members
    ]
    digest.update(msgspec.json.encode(settings, order="sorted"))
    return digest.hexdigest()[:LENGTH]


VERSION = re.compile(r"[\w.+/-]{1,80}")


def _find_version(given: str, suite: Suite, url: str | None) -> str:
    """Return the version that was given, or else a fingerprint of the planners installed here.

    Raises:
        InvalidValue: it cannot be part of a name; or none is given, and the planners are elsewhere.
    """
    if given and not VERSION.fullmatch(given):
        raise InvalidValue(
            "planner-version",
            f"'{given}' is not a valid version: use up to 80 letters, digits and . _ + / -.",
            "Give a commit or a tag.",
        )
    if url and not given:
        raise InvalidValue(
            "planner-version",
            "is not given, and the code of a remote service cannot be read.",
            "Name the installed version, such as a commit.",
        )
    return given or fingerprint(suite)


SHOWN = 5
"""How many failures of each member that close the gate are printed; --json and JUnit have more."""


def describe_report(report: GateReport) -> Iterator[tables.Block]:
    """Yield the tables of a report, and its conclusions in sentences."""
    for tabulate in (_tabulate_known, _tabulate_reruns, _tabulate_findings):
        table = tabulate(report)
        if table.rows:
            yield from (table, "")
    yield from list_conclusions(report)
    yield from _point_to_releases(report)


def _point_to_releases(report: GateReport) -> Iterator[str]:
    """Yield what to type to see what became of each failure mode over all versions."""
    reruns = (member.rerun for member in report.members if member.rerun)
    found = [rerun for rerun in reruns if traits_of(rerun.method).finds_new]
    commands = ", ".join(f"eigenfail release show {each.now.campaign}" for each in found)
    # Without a failure there is nothing to analyse.
    first = "analyse the new campaigns, then: " if any(each.now.failures for each in found) else ""
    if commands:
        yield f"Failure modes over all versions: {first}{commands}"


def _tabulate_known(report: GateReport) -> tables.Table:
    """The known failures of the baseline, one a row."""
    columns = tables.name_columns("Member", "Known failure", "Now", "Replay")
    rows = (
        (member.member, known.what, known.verdict, known.replay or None)
        for member in report.members
        for known in member.known
    )
    return tables.Table("Known failures", columns, tuple(rows))


def _tabulate_reruns(report: GateReport) -> tables.Table:
    """The campaigns that were run again: failures before and now, what became of them, and why."""
    columns = (
        *tables.name_columns("Member"),
        *tables.count_columns("Baseline", "Failures", "Rerun", "Failures now"),
        *tables.count_columns("New", "Fixed", "Still failing"),
        *tables.name_columns("Verdict", "Because"),
    )
    rows = (_list_rerun_row(each.member, each.rerun) for each in report.members if each.rerun)
    return tables.Table("Reruns", columns, tuple(rows))


def _list_rerun_row(member: str, rerun: Rerun) -> tuple[tables.Cell, ...]:
    sides = (
        text
        for side in (rerun.before, rerun.now)
        for text in (str(side.campaign), f"{side.failures}/{side.completed}")
    )
    nothing = None if rerun.unpaired_because else 0
    verdicts = (GateVerdict.NEW, GateVerdict.FIXED, GateVerdict.STILL_FAILING)
    counts = (rerun.counts.get(each, nothing) for each in verdicts)
    return (member, *sides, *counts, rerun.verdict, rerun.summary)


def _list_findings(report: GateReport) -> Iterator[tuple[str, GateFinding]]:
    """Return new modes and a bounded number of the findings that close the gate."""
    for member in report.members:
        closing = [each for each in member.known if each.verdict in CLOSING]
        if rerun := member.rerun:
            yield from ((member.member, each) for each in rerun.new_modes)
            whole = rerun.unpaired_because and rerun.verdict in CLOSING
            closing += [each for each in rerun.findings if whole or each.verdict in CLOSING]
        yield from ((member.member, each) for each in closing[:SHOWN])


def _tabulate_findings(report: GateReport) -> tables.Table:
    """Episodes to look at, one a row."""
    columns = tables.name_columns("Look at", "Episode", "Verdict", "Replay", "Page")
    rows = (
        (member, found.what, found.verdict, found.replay or found.problem, found.link)
        for member, found in _list_findings(report)
    )
    return tables.Table("Episodes to look at", columns, tuple(rows))


def tabulate_summaries(found: Iterable[GateSummary]) -> tables.Table:
    """Return the results of gates, one a row."""
    return tables.tabulate(
        "Gates",
        found,
        tables.Reading(ID, lambda each: str(each.id)),
        tables.read_text("Suite", "suite"),
        tables.read_text("Version", "version"),
        tables.read_text("Baseline", lambda each: each.baseline or None),
        tables.read_text("Verdict", "verdict"),
        tables.read_text("Counts", lambda each: join_counts(each.counts) or "none"),
        tables.read_utc("Created", "created_ms"),
    )


EXIT_CLOSED = 1
RUN = "run"


class GateCommands(TyperGroup):
    """`eigenfail gate`, which runs the gate of a file if no other command is named."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Put the command in front of a file."""
        # The file of a suite may be called anything but the name of a command.
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
        help="Baseline: a version that was gated, which is looked up first, a suite or its file"
        " that was run, or campaigns such as 1,2,3. Without it, this run becomes one.",
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
    version = _find_version(planner_version, suite, url)
    # Empty is a variable of a pipeline that was never set: without this, the run would become a
    # baseline, and the gate would be open.
    if baseline is not None and not baseline.strip():
        raise InvalidValue("baseline", "is empty.", "Specify a baseline, or omit --baseline.")
    asked = GateRun(
        suite=suite.name,
        version=version,
        run=name_run(suite.name, version),
        baseline=baseline or "",
        strict=strict,
        by=by,
        file=str(file),
    )
    # Before anything is run: a gate may take hours.
    if junit and not junit.parent.is_dir():
        raise InvalidValue("junit", f"Folder {junit.parent} does not exist.", "Create it first.")
    with connect_for_suite(context, suite, url, Plan(data, 0, workers)) as (client, place):
        try:
            report = Runner(client, place, this_command()).run(suite, asked)
        except KeyboardInterrupt:  # between campaigns; during one, `run_suite` pauses them
            typer.echo(f"Interrupted. To continue, run: {this_command()}", err=True)
            raise typer.Exit(INTERRUPTED) from None
        _record_verdict(client, report)
    if junit:
        _write_junit(junit, to_junit(report))
    show(report, as_json, *describe_report(report))
    _exit_by_verdict(report)


def _record_verdict(client: Client, report: GateReport) -> None:
    """Report the verdict to the service, for its pages and its event log.

    The verdict of this command is the same where the service does not take it.
    """
    # What says nothing of the planner must not stand among its verdicts.
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
    # Exit code 3, not 1: a pipeline must not blame the planner for what could not be judged.
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
        raise typer.Exit(EXIT_CLOSED)


@app.command("list")
@prints_answer()
def list_gates(client: Client, limit: Limit = 50) -> CommandResult:
    """List the results of gates, newest first."""
    return first_rows(client.gates.list(), limit, tabulate_summaries)


@app.command("show")
@prints_answer()
def show_gate(client: Client, gate: GateId) -> CommandResult:
    """Show the result of a gate, as the gate printed it."""
    found = client.gates.get(gate)
    return CommandResult(found, *describe_report(found.report))
