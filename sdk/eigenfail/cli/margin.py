"""`eigenfail margin`: how much noise a planner bears before it fails, by bisection."""

from typing import Annotated

import msgspec
import typer
from rich.console import Group
from rich.table import Table
from rich.text import Text

from eigenfail.cli.connection import MaybeUrl, Place, connect_for_campaign
from eigenfail.cli.options import AsJson, Data, Seed, SpecFile, Workers
from eigenfail.cli.render import run_suite, show
from eigenfail.cli.specs import read_spec
from eigenfail.client import Client
from eigenfail.hosting.folder import DEFAULT_DATA
from eigenfail.hosting.service import Plan
from eigenfail.margin import (
    FINEST,
    LARGEST_SCALE,
    Criterion,
    Margin,
    MarginStep,
    ScaleRange,
    build_step_suite,
    choose_criterion,
    describe_margin,
    find_margin,
    list_known_steps,
    read_step,
)
from eigenfail.presentation.figures import UNKNOWN, format_percent_interval, format_upper_bound
from eigenfail.presentation.terminal import start_grid
from eigenfail.suites import Suite

SMALLEST_TARGET, LARGEST_TARGET = 1e-6, 0.5

app = typer.Typer(add_completion=False)

Low = Annotated[
    float, typer.Option(min=FINEST, max=LARGEST_SCALE, help="Smallest scale of the noise to try.")
]
High = Annotated[
    float, typer.Option(min=FINEST, max=LARGEST_SCALE, help="Largest scale of the noise to try.")
]
Tolerance = Annotated[
    float,
    typer.Option(
        min=FINEST,
        max=LARGEST_SCALE,
        help="Largest distance between a scale that passed and one that did not.",
    ),
]
Budget = Annotated[
    int | None,
    typer.Option(min=1, help="Budget of each scale, replacing that of the file. [episodes]"),
]

Target = Annotated[
    float | None,
    typer.Option(
        min=SMALLEST_TARGET,
        max=LARGEST_TARGET,
        help="Largest failure rate that is accepted, to be shown with 95 % confidence at each "
        "scale; monte_carlo only. Without it a scale passes if no failure is found.",
    ),
]


class MarginReport(msgspec.Struct, frozen=True):
    """What `eigenfail margin` says.

    Attributes:
        searched: where, and how finely.
        target: largest failure rate that is accepted; None: no failure may be found.
        conclusions: what it means, in sentences.
    """

    planner: str
    method: str
    searched: ScaleRange
    target: float | None
    margin: Margin
    conclusions: list[str]


@app.command()
def margin(
    context: typer.Context,
    file: SpecFile,
    low: Low = 0.5,
    high: High = 3.0,
    tolerance: Tolerance = 0.1,
    budget: Budget = None,
    target: Target = None,
    url: MaybeUrl = None,
    data: Data = DEFAULT_DATA,
    workers: Workers = 0,
    seed: Seed = None,
    as_json: AsJson = False,
) -> None:
    """Find the noise scale at which a planner starts to fail, by bisection.

    Each scale of the disturbance model is a campaign with the method of the file, which ends with
    its first failure, or with as many as show a rate above the target. Scales that the service has
    tried before are not tried again, so that the same command resumes an interrupted search. Where
    it runs is decided as by `eigenfail run`.
    """
    searched = ScaleRange(low, high, tolerance)
    spec = read_spec(file, episodes=budget, seed=seed)
    criterion = choose_criterion(target, spec)
    with connect_for_campaign(context, spec, url, Plan(data, 0, workers)) as (client, place):
        found = find_margin(
            lambda scale: _measure(
                client, place, build_step_suite(spec, scale, criterion), criterion
            ),
            searched,
            list_known_steps(client, spec, criterion),
        )
    conclusions = describe_margin(found, criterion, spec.method)
    report = MarginReport(spec.planner, spec.method, searched, target, found, conclusions)
    show(report, as_json, lambda: _draw_report(report))


def _measure(client: Client, place: Place, suite: Suite, criterion: Criterion) -> MarginStep:
    """Run the campaign of a scale, or go on with it, and see what it found.

    Raises:
        ServiceError: it came to nothing.
    """
    (campaign,) = run_suite(client, suite, place.check, "rerun the same command")
    return read_step(client, campaign, criterion)


def _draw_report(report: MarginReport) -> Group:
    """For people."""
    return Group(_draw_steps(report.margin.steps), "", *map(Text, report.conclusions))


def _draw_steps(steps: tuple[MarginStep, ...]) -> Table:
    """One row for each scale that was tried."""
    columns = ("scale", "id", "episodes", "failures", "failed [95 %]", "verdict")
    grid = start_grid(*columns, right=columns[:-1])
    for step in steps:
        figures = (step.campaign, step.episodes, step.failures)
        grid.add_row(f"{step.scale:.4g}", *map(str, figures), _format_rate(step), step.verdict)
    return grid


def _format_rate(step: MarginStep) -> str:
    """Return the interval of the failure rate, or its upper bound after no failure."""
    if step.interval is None:
        return UNKNOWN
    if not step.failures:
        return format_upper_bound(step.interval.high)
    return format_percent_interval(step.interval)
