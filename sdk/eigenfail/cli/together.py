"""Campaigns run together: one progress display, one way out by Ctrl-C, one way on."""

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager

import typer
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from eigenfail.cli.interruption import INTERRUPTED, PAUSE_WITHIN_S
from eigenfail.cli.progress import LINE_EVERY_S
from eigenfail.client import Client
from eigenfail.client.campaigns import AT_REST
from eigenfail.errors import ServiceError
from eigenfail.suites import Suite
from eigenfail.values import Campaign, Counts

Seen = Sequence[Campaign | None]
Report = Callable[[Seen], None]


def run_together(
    client: Client, suite: Suite, check: Callable[[], None], command: str
) -> tuple[Campaign, ...]:
    """Start what is missing or paused, and follow all of it to its end.

    On Ctrl-C all of it is paused, the way on is said, and the exit code is 130.

    Args:
        client: of the service that runs it.
        suite: the campaigns.
        check: raises if the service is in trouble.
        command: what goes on with it.
    """
    try:
        return follow_together(client, suite, check)
    except KeyboardInterrupt:
        seen = pause_together(client, suite)
        typer.echo(f"{line(suite.name, seen)}. To go on: {command}", err=True)
        raise typer.Exit(INTERRUPTED) from None


def follow_together(
    client: Client, suite: Suite, check: Callable[[], None]
) -> tuple[Campaign, ...]:
    """Start them, and show their progress until all have ended or are paused."""
    with reporter(suite.name) as report:

        def look(seen: Seen) -> None:
            check()
            report(seen)

        ended = client.suites.run(suite, look)
    return tuple(campaign for campaign in ended if campaign is not None)


def pause_together(client: Client, suite: Suite) -> Seen:
    """The campaigns, paused unless they ended first; some may still be pausing after a while."""
    try:
        client.suites.pause(suite)
        return client.suites.wait(suite, timeout_s=PAUSE_WITHIN_S)
    except ServiceError:
        return client.suites.find(suite)


@contextmanager
def reporter(name: str) -> Iterator[Report]:
    """Where progress goes: standard error, so that standard output holds results alone."""
    screen = Console(stderr=True, highlight=False)
    if not screen.is_terminal:
        yield Lines(name)
        return
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn())
    ends = (TextColumn("{task.fields[failures]} failures"), TimeRemainingColumn())
    with Progress(*columns, *ends, console=screen, transient=True) as bar:
        yield Bar(name, bar)


class Bar:
    """One bar over the episodes of all of them."""

    def __init__(self, name: str, progress: Progress) -> None:
        self.name = name
        self.progress = progress
        self.task = progress.add_task("", failures=0)

    def __call__(self, seen: Seen) -> None:
        """Draw them as they stand."""
        counts = counted(seen)
        self.progress.update(
            self.task,
            description=headline(self.name, seen),
            completed=counts.completed + counts.failed,
            total=counts.planned - counts.cancelled,
            failures=counts.failures,
        )


class Lines:
    """A line whenever one of them ended, and every few seconds between."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.headline = ""
        self.last_s = 0.0

    def __call__(self, seen: Seen) -> None:
        """Print a line, if one is due."""
        now_s, now = time.monotonic(), headline(self.name, seen)
        if now == self.headline and now_s - self.last_s < LINE_EVERY_S:
            return
        self.headline, self.last_s = now, now_s
        typer.echo(line(self.name, seen), err=True)


def line(name: str, seen: Seen) -> str:
    """How far they came."""
    counts = counted(seen)
    done = f"{counts.completed + counts.failed}/{counts.planned - counts.cancelled} episodes"
    return f"{headline(name, seen)}: {done}, {counts.failures} failures"


def headline(name: str, seen: Seen) -> str:
    """How many of them are at rest."""
    resting = [campaign for campaign in seen if campaign and campaign.state in AT_REST]
    paused = sum(campaign.state == "paused" for campaign in resting)
    rests = f", {paused} paused" if paused else ""
    return f"{name}: {len(resting) - paused} of {len(seen)} campaigns over{rests}"


def counted(seen: Seen) -> Counts:
    """The episodes of all of them."""
    counts = [campaign.counts for campaign in seen if campaign]
    sums = {name: sum(getattr(each, name) for each in counts) for name in Counts.__struct_fields__}
    return Counts(**sums)
