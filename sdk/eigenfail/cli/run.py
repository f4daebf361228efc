"""`eigenfail run`: from a TOML file to a result table, starting whatever is missing."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Annotated, NamedTuple

import typer

from eigenfail.cli.data_folder import DataFolder
from eigenfail.cli.interruption import follow_or_pause
from eigenfail.cli.local_service import Plan, local_service
from eigenfail.cli.minimal_words import shrunk, with_words
from eigenfail.cli.options import (
    DEFAULT_DATA,
    DEFAULT_URL,
    AsJson,
    Data,
    Episodes,
    Gate,
    Seed,
    SpecFile,
    StopCost,
    StopCv,
    StopFailures,
    StopHalfWidth,
    StopWall,
    Workers,
)
from eigenfail.cli.output import show
from eigenfail.cli.progress import nothing_wrong
from eigenfail.cli.signals import interruptible
from eigenfail.cli.specs import check_plugins, read_spec
from eigenfail.cli.surroundings import client_at
from eigenfail.cli.tables import result_table
from eigenfail.cli.verdict import judge
from eigenfail.client import Client
from eigenfail.errors import ServiceUnreachable
from eigenfail.values import CampaignSpec

MaybeUrl = Annotated[
    str | None,
    typer.Option("--url", envvar="EIGENFAIL_URL", help="A service that runs already."),
]

app = typer.Typer(add_completion=False)


class Place(NamedTuple):
    """A service to run on; `check` raises if it is in trouble, `again` starts it another time."""

    url: str
    check: Callable[[], None] = nothing_wrong
    again: str = ""


@app.command()
def run(
    context: typer.Context,
    file: SpecFile,
    url: MaybeUrl = None,
    data: Data = DEFAULT_DATA,
    workers: Workers = 0,
    episodes: Episodes = None,
    seed: Seed = None,
    stop_failures: StopFailures = None,
    stop_half_width: StopHalfWidth = None,
    stop_cv: StopCv = None,
    stop_wall_s: StopWall = None,
    stop_cost_usd: StopCost = None,
    gate: Gate = False,
    as_json: AsJson = False,
) -> None:
    """Run the campaign that a TOML file describes, and print its results.

    Uses the service at --url, or one that runs on the data folder or, if no folder is named, at the
    default address; otherwise starts one on the folder for as long as the campaign takes.
    Ctrl-C pauses the campaign and says how to go on.
    """
    stop = {
        "failures": stop_failures,
        "half_width": stop_half_width,
        "cv": stop_cv,
        "wall_s": stop_wall_s,
        "cost_usd": stop_cost_usd,
    }
    spec = read_spec(file, stop, episodes=episodes, seed=seed)
    with client_somewhere(context, spec, url, Plan(data, 0, workers)) as (client, place):
        created = client.campaigns.create(spec)
        ended = follow_or_pause(client, created.id, place.check, place.again)
        summary = client.campaigns.summary(ended.id)
        words = shrunk(client, ended)
    show(summary, as_json, lambda: with_words(result_table([summary]), words))
    judge(ended, gate)


@contextmanager
def client_somewhere(
    context: typer.Context, spec: CampaignSpec, url: str | None, plan: Plan
) -> Iterator[tuple[Client, Place]]:
    """A client of `somewhere`; Ctrl-C reaches the block as KeyboardInterrupt.

    Raises:
        ServiceUnreachable: nothing answers at the address that was asked for.
    """
    with (
        interruptible(),
        somewhere(context, spec, url, plan) as place,
        client_at(context, place.url) as client,
    ):
        yield client, place


@contextmanager
def somewhere(
    context: typer.Context, spec: CampaignSpec, url: str | None, plan: Plan
) -> Iterator[Place]:
    """A service that runs, or one that is started for as long as the block lasts.

    Raises:
        ServiceUnreachable: nothing answers at the address that was asked for.
    """
    for address in (url,) if url else nearby(context, plan):
        if is_healthy(context, address):
            yield Place(address)
            return
    if url:
        raise ServiceUnreachable(
            f"No eigenfail service answers at {url}.",
            "Start one with 'eigenfail up', or leave --url out and one is started for this run.",
        )
    check_plugins(spec)
    with local_service(plan) as service:
        try:
            yield Place(service.address.url, service.check, f"eigenfail up --data {plan.data}")
        except ServiceUnreachable:
            # Which of its processes ended, and why, says more than that nobody answers.
            service.check()
            raise


def nearby(context: typer.Context, plan: Plan) -> Iterator[str]:
    """Where a service may run: on the folder; elsewhere only if no folder was asked for."""
    if running := DataFolder(plan.data).address():
        yield running.url
    source = context.get_parameter_source("data")
    if source is None or source.name == "DEFAULT":
        yield DEFAULT_URL


def is_healthy(context: typer.Context, url: str) -> bool:
    """Whether a service answers there."""
    with client_at(context, url) as client:
        return client.health()
