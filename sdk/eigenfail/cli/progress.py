"""A campaign as it goes: a bar for people, plain lines when nobody looks."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import typer
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from eigenfail.client import Client
from eigenfail.values import Campaign, CampaignState

LINE_EVERY_S = 5.0

Report = Callable[[Campaign], None]


def nothing_wrong() -> None:
    """The check of a service that somebody else looks after."""


def follow(client: Client, campaign: int, check: Callable[[], None] = nothing_wrong) -> Campaign:
    """Show the campaign's progress until it has ended or is paused.

    Args:
        client: of the service that runs it.
        campaign: its id.
        check: raises if the service is in trouble.
    """
    with reporter() as report:

        def look(seen: Campaign) -> None:
            check()
            report(seen)

        ended = client.campaigns.wait(campaign, look)
    if ended.state is CampaignState.DONE:
        typer.echo(f"{headline(ended)}: {ended.stopped_because}", err=True)
    return ended


@contextmanager
def reporter() -> Iterator[Report]:
    """Where progress goes: standard error, so that standard output holds results alone."""
    screen = Console(stderr=True, highlight=False)
    if not screen.is_terminal:
        yield PlainLines()
        return
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn())
    ends = (TextColumn("{task.fields[failures]} failures"), TimeRemainingColumn())
    with Progress(*columns, *ends, console=screen, transient=True) as bar:
        yield Bar(bar)


class Bar:
    """A progress bar with failures and the time to go."""

    def __init__(self, progress: Progress) -> None:
        self.progress = progress
        self.task = progress.add_task("", failures=0)

    def __call__(self, campaign: Campaign) -> None:
        """Draw the campaign as it stands."""
        counts = campaign.counts
        self.progress.update(
            self.task,
            description=headline(campaign),
            completed=counts.completed + counts.failed,
            total=counts.planned - counts.cancelled,
            failures=counts.failures,
        )


class PlainLines:
    """A line at every change of state, and every few seconds between."""

    def __init__(self) -> None:
        self.state = ""
        self.last_s = 0.0

    def __call__(self, campaign: Campaign) -> None:
        """Print a line, if one is due."""
        now_s = time.monotonic()
        if campaign.state == self.state and now_s - self.last_s < LINE_EVERY_S:
            return
        self.state, self.last_s = campaign.state, now_s
        counts = campaign.counts
        done = f"{counts.completed + counts.failed}/{counts.planned} episodes"
        line = f"{headline(campaign)}: {done}, {counts.failures} failures"
        typer.echo(line, err=True)


def headline(campaign: Campaign) -> str:
    """Which campaign, and where it is in its life."""
    return f"campaign {campaign.id} ({campaign.spec.method}) {campaign.state}"
