"""Find the largest errors of the sensor at which failures stay rare enough."""

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated

import msgspec
import typer

from eigenfail.cli.connection import MaybeUrl, connect_for_campaign
from eigenfail.cli.options import AsJson, Data, Seed, SpecFile, Workers
from eigenfail.cli.render import run_suite, show
from eigenfail.cli.specs import read_spec
from eigenfail.errors import InvalidValue
from eigenfail.files import write_new
from eigenfail.hosting.folder import DEFAULT_DATA
from eigenfail.hosting.service import Plan
from eigenfail.presentation.tables import Block, Table, count_columns, name_columns
from eigenfail.settings import convert
from eigenfail.suites import Suite
from eigenfail.values.campaign import Campaign
from eigenfail_assurance.sensor import sentences
from eigenfail_assurance.sensor.anchors import check_question, find_sensor_requirement
from eigenfail_assurance.sensor.page import format_page
from eigenfail_assurance.sensor.scaling import SCALE
from eigenfail_assurance.sensor.search import MultipleRange, RequirementAnswer, RequirementQuestion

app = typer.Typer(add_completion=False)

Target = Annotated[
    float, typer.Option(help="Largest probability of failure that is accepted, between 0 and 1.")
]
Channels = Annotated[
    str,
    typer.Option(
        help="Channels whose errors are scaled, with commas: each alone, and two of them also "
        "jointly. `scale` is every sigma at once."
    ),
]
Low = Annotated[
    float, typer.Option(help="Smallest error to try, as a multiple of the campaign's own.")
]
High = Annotated[
    float, typer.Option(help="Largest error to try, as a multiple of the campaign's own.")
]
Tolerance = Annotated[
    float, typer.Option(help="Errors on the grid of the search differ by this share at most.")
]
Points = Annotated[
    int,
    typer.Option(help="Points of the frontier of two channels, multiples of the first; 0: none."),
]
Confidence = Annotated[
    float, typer.Option(help="Confidence of each statement, and of the whole frontier.")
]
Budget = Annotated[
    int | None,
    typer.Option(min=1, help="Budget of each campaign, replacing that of the file. [episodes]"),
]
Output = Annotated[
    Path | None, typer.Option("--output", "-o", help="Also write the answer as one HTML page.")
]
Force = Annotated[bool, typer.Option("--force", help="Replace the page that is there.")]


class RequirementReport(msgspec.Struct, frozen=True):
    """What `eigenfail requirement` says.

    Attributes:
        answer: limits, frontier, and the campaigns that they rest on.
        conclusions: what it means, in sentences.
    """

    planner: str
    scenario: str
    method: str
    answer: RequirementAnswer
    conclusions: list[str]


@app.command()
def requirement(
    context: typer.Context,
    file: SpecFile,
    target: Target,
    channels: Channels = SCALE,
    low: Low = 0.5,
    high: High = 2.0,
    tolerance: Tolerance = 0.05,
    points: Points = 3,
    confidence: Confidence = 0.95,
    budget: Budget = None,
    output: Output = None,
    force: Force = False,
    url: MaybeUrl = None,
    data: Data = DEFAULT_DATA,
    workers: Workers = 0,
    seed: Seed = None,
    as_json: AsJson = False,
) -> None:
    """Find the largest errors of the sensor at which failures stay rare enough.

    P(failure) is bounded by a campaign for each error that is tried, with the method of the file:
    monte_carlo, subset, mixture or splitting. All else is as in the file. Campaigns that the
    service has run before are not run again, so that the same command resumes an interrupted
    search. Where it runs is decided as by `eigenfail run`.
    """
    within = convert({"low": low, "high": high, "tolerance": tolerance}, MultipleRange)
    given = {
        "target": target,
        "channels": [name.strip() for name in channels.split(",")],
        "within": msgspec.to_builtins(within),
        "confidence": confidence,
        "points": points,
    }
    question = convert(given, RequirementQuestion)
    spec = read_spec(file, episodes=budget, seed=seed)
    check_question(spec, question)
    if output is not None:
        _check_output(output, force=force)
    with connect_for_campaign(context, spec, url, Plan(data, 0, workers)) as (client, place):

        def run(suite: Suite) -> Campaign:
            (campaign,) = run_suite(client, suite, place.check, "rerun the same command")
            return campaign

        answer = find_sensor_requirement(client, spec, question, run)
    conclusions = sentences.describe_answer(spec, answer)
    if output is not None:
        draft = output.with_name(f".{output.name}.new")
        draft.unlink(missing_ok=True)
        write_new(draft, format_page(spec, answer), "--output")
        draft.replace(output)
    report = RequirementReport(spec.planner, spec.scenario, spec.method, answer, conclusions)
    show(report, as_json, *_describe_report(report, output))


def _check_output(output: Path, *, force: bool) -> None:
    """Refuse a page that cannot be written, before the campaigns run."""
    if output.is_dir() or not output.parent.is_dir():
        problem = f"'{output}' is a folder." if output.is_dir() else "its folder does not exist."
        raise InvalidValue("--output", problem, "Choose another file.")
    if output.exists() and not force:
        remedy = "Choose another file, or give --force to replace it."
        raise InvalidValue("--output", f"'{output}' exists already.", remedy)


def _describe_report(report: RequirementReport, output: Path | None) -> Iterator[Block]:
    answer = report.answer
    first, *numbers, last = sentences.ANCHOR_COLUMNS
    columns = (*name_columns(first), *count_columns(*numbers), *name_columns(last))
    yield Table("Errors", columns, tuple(map(sentences.list_anchor_row, answer.anchors)))
    yield ""
    if answer.frontier:
        rows = tuple(map(sentences.list_frontier_row, answer.frontier))
        yield Table("Frontier", name_columns(*sentences.FRONTIER_COLUMNS), rows)
        yield ""
    yield from report.conclusions
    if output is not None:
        yield f"The page is {output}."
