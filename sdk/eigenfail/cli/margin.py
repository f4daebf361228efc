"""`eigenfail margin`: how much noise a planner bears before it fails, by bisection."""

from typing import Annotated

import msgspec
import typer
from rich.console import Group
from rich.table import Table
from rich.text import Text

from eigenfail.cli.figures import UNKNOWN
from eigenfail.cli.options import DEFAULT_DATA, AsJson, Data, Seed, SpecFile, Workers
from eigenfail.cli.output import show
from eigenfail.cli.places import MaybeUrl, Place, client_somewhere
from eigenfail.cli.specs import read_spec
from eigenfail.cli.tables import table
from eigenfail.cli.together import run_together
from eigenfail.client import Client
from eigenfail.hosting.service import Plan
from eigenfail.margin import (
    Margin,
    Range,
    Step,
    conclusions,
    find_margin,
    known_steps,
    step_of,
    step_suite,
)
from eigenfail.margin.bisection import FINEST, LARGEST_SCALE
from eigenfail.values import CampaignSpec

app = typer.Typer(add_completion=False)

Low = Annotated[
    float, typer.Option(min=FINEST, max=LARGEST_SCALE, help="Smallest scale of the noise to try.")
]
High = Annotated[
    float, typer.Option(min=FINEST, max=LARGEST_SCALE, help="Largest scale of the noise to try.")
]
Tolerance = Annotated[
    float,
    typer.Option(min=FINEST, max=LARGEST_SCALE, help="How near failing and safe scales must be."),
]
Budget = Annotated[
    int | None, typer.Option(min=1, help="Of each scale, instead of the file's. [episodes]")
]


class MarginReport(msgspec.Struct, frozen=True):
    """What `eigenfail margin` says.

    Attributes:
        searched: where, and how finely.
        conclusions: what it means, in sentences.
    """

    planner: str
    method: str
    searched: Range
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
    url: MaybeUrl = None,
    data: Data = DEFAULT_DATA,
    workers: Workers = 0,
    seed: Seed = None,
    as_json: AsJson = False,
) -> None:
    """Find by bisection how much noise a planner bears before it fails.

    Each scale of the disturbance model is a campaign with the method of the file, which ends with
    its first failure. What the service has tried before is not tried again, so that a search that
    was interrupted goes on where it stopped. Where it runs is decided as by `eigenfail run`.
    """
    searched = Range(low, high, tolerance)
    spec = read_spec(file, episodes=budget, seed=seed)
    with client_somewhere(context, spec, url, Plan(data, 0, workers)) as (client, place):
        found = find_margin(
            lambda scale: measure(client, place, spec, scale), searched, known_steps(client, spec)
        )
    report = MarginReport(
        spec.planner, spec.method, searched, found, conclusions(found, spec.method)
    )
    show(report, as_json, lambda: drawn(report))


def measure(client: Client, place: Place, spec: CampaignSpec, scale: float) -> Step:
    """Run the campaign of a scale, or go on with it, and see what it found.

    Raises:
        ServiceError: it came to nothing.
    """
    suite = step_suite(spec, scale)
    (campaign,) = run_together(client, suite, place.check, "the same command again")
    return step_of(client, campaign)


def drawn(report: MarginReport) -> Group:
    """For people."""
    return Group(step_table(report.margin.steps), "", *map(Text, report.conclusions))


def step_table(steps: tuple[Step, ...]) -> Table:
    """One row for each scale that was tried."""
    columns = ("scale", "id", "episodes", "failures", "failure rate at most [95 %]")
    grid = table(*columns, right=columns)
    for step in steps:
        figures = (step.campaign, step.episodes, step.failures)
        grid.add_row(f"{step.scale:.4g}", *map(str, figures), bound(step))
    return grid


def bound(step: Step) -> str:
    """Up to where the rate of failures may be after none was found."""
    return UNKNOWN if step.upper_bound is None else f"{100.0 * step.upper_bound:.1f} %"
