"""`eigenfail gate`: new, fixed and remaining failures of another version of a planner."""

import re
from collections.abc import Iterator
from contextlib import suppress
from hashlib import sha256
from importlib.metadata import distributions
from pathlib import Path
from typing import Annotated

import msgspec
import typer
from rich.console import Group, RenderableType
from rich.markup import escape
from rich.table import Table
from rich.text import Text

from eigenfail.cli.connection import MaybeUrl, connect_for_suite, this_command
from eigenfail.cli.gate_runs import Runner
from eigenfail.cli.options import AsJson, Data, Workers
from eigenfail.cli.render import INTERRUPTED, show
from eigenfail.client import Client
from eigenfail.errors import EigenfailError, InvalidValue, ServiceError
from eigenfail.fingerprints import LENGTH, list_packages, read_package_files
from eigenfail.gate.baselines import name_run
from eigenfail.gate.report import GateReport, GateRun, list_conclusions, to_junit
from eigenfail.gate.reruns import GateFinding, JudgedBy, Rerun, RerunFigures
from eigenfail.gate.verdicts import CLOSING, GateVerdict
from eigenfail.hosting.folder import DEFAULT_DATA
from eigenfail.hosting.service import Plan
from eigenfail.presentation.figures import UNKNOWN
from eigenfail.presentation.terminal import start_grid
from eigenfail.suites import Suite
from eigenfail.values.webhooks import (
    LONGEST_NAME,
    LONGEST_SENTENCE,
    MOST_SENTENCES,
    GateVerdictRecord,
)


def _check_folder(junit: Path | None) -> None:
    """Raises InvalidValue, before anything is run, if no report can be written there."""
    if junit and not junit.parent.is_dir():
        raise InvalidValue("junit", f"Folder {junit.parent} does not exist.", "Create it first.")


def _write_junit(file: Path, content: bytes) -> None:
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


SHOWN = 5
"""How many failures of each member that close the gate are printed; --json and JUnit have more."""


def draw_report(report: GateReport) -> Group:
    """All of it, for people."""
    return Group(*_draw_parts(report))


def _draw_parts(report: GateReport) -> Iterator[RenderableType]:
    """The parts of the page."""
    if any(member.known for member in report.members):
        yield _draw_known_failures(report)
        yield Text()
    if any(member.rerun for member in report.members):
        yield _draw_reruns(report)
        yield Text()
    if findings := list(_list_findings(report)):
        yield _draw_findings(findings)
        yield Text()
    yield from map(Text, list_conclusions(report))


def _draw_known_failures(report: GateReport) -> Table:
    """The known failures of the baseline, one a row."""
    grid = start_grid("member", "known failure", "now", "replay")
    for member in report.members:
        for known in member.known:
            cells = (member.member, known.what, known.verdict, known.replay or UNKNOWN)
            grid.add_row(*map(escape, cells))
    return grid


def _draw_reruns(report: GateReport) -> Table:
    """The campaigns that were run again, one a row."""
    counted = ("baseline", "failures", "rerun", "failures now", "new", "fixed", "still failing")
    grid = start_grid("member", *counted, "verdict", "because", right=counted)
    for member in report.members:
        if rerun := member.rerun:
            grid.add_row(*map(escape, (member.member, *_make_rerun_row(rerun))))
    return grid


def _make_rerun_row(rerun: Rerun) -> tuple[str, ...]:
    """Failures before and now, what became of them, and why."""
    sides = (_format_side(rerun.before), _format_side(rerun.now))
    counted = (GateVerdict.NEW, GateVerdict.FIXED, GateVerdict.STILL_FAILING)
    nothing = UNKNOWN if rerun.unpaired_because else "0"
    counts = (str(rerun.counts.get(each, nothing)) for each in counted)
    return (*sides[0], *sides[1], *counts, rerun.verdict, rerun.summary)


def _format_side(figures: RerunFigures) -> tuple[str, str]:
    """A campaign, and how many of its episodes fail."""
    return str(figures.campaign), f"{figures.failures}/{figures.completed}"


def _list_findings(report: GateReport) -> Iterator[tuple[str, GateFinding]]:
    """Return new modes and a bounded number of the findings that close the gate."""
    for member in report.members:
        closing = [each for each in member.known if each.verdict in CLOSING]
        if rerun := member.rerun:
            yield from ((member.member, each) for each in rerun.new_modes)
            whole = rerun.unpaired_because and rerun.verdict in CLOSING
            closing += [each for each in rerun.findings if whole or each.verdict in CLOSING]
        yield from ((member.member, each) for each in closing[:SHOWN])


def _draw_findings(findings: list[tuple[str, GateFinding]]) -> Table:
    """Episodes to look at, one a row."""
    grid = start_grid("look at", "episode", "verdict", "replay", "page")
    for member, found in findings:
        seen = (found.replay or found.problem, found.link)
        cells = (member, found.what, found.verdict, *seen)
        grid.add_row(*(escape(cell) for cell in cells))
    return grid


CLOSED = 1

app = typer.Typer(add_completion=False)

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


@app.command()
def gate(
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
        suite=suite.name, version=version, run=run, baseline=against, strict=strict, by=by
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
    """Report the verdict to the service, for its event log and webhooks.

    The verdict of this command is the same where the service does not take it.
    """
    if report.in_trouble:
        return
    sentences = [each[:LONGEST_SENTENCE] for each in list_conclusions(report)]
    record = GateVerdictRecord(
        suite=report.gate.suite[:LONGEST_NAME],
        version=report.gate.version[:LONGEST_NAME],
        run=report.gate.run[:LONGEST_NAME],
        baseline=report.gate.baseline[:LONGEST_NAME],
        passed=report.open,
        conclusions=tuple(sentences[:MOST_SENTENCES]),
    )
    try:
        client.record_gate(record)
    except EigenfailError as error:
        typer.echo(f"The service did not record the verdict: {error}", err=True)


def _exit_by_verdict(report: GateReport) -> None:
    """Exit with 1 if the gate is closed.

    Raises:
        ServiceError: only because episodes were lost, which says nothing of the planner.
    """
    if report.in_trouble:
        raise ServiceError(
            f"The gate of {report.gate.run} is inconclusive: {next(report.problems(), '')}",
            "Check the workers, then use a different --planner-version.",
        )
    if not report.open:
        raise typer.Exit(CLOSED)
