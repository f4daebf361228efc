"""Campaigns run together: one progress display, one way out by Ctrl-C, one way on."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager

import typer

from eigenfail.cli.interruption import INTERRUPTED, PAUSE_WITHIN_S
from eigenfail.client import Client
from eigenfail.client.campaigns import AT_REST
from eigenfail.errors import ServiceError
from eigenfail.progress import Standing, display
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
    with display() as show:
        yield lambda seen: show(standing(name, seen))


def standing(name: str, seen: Seen) -> Standing:
    """How far they are together."""
    counts = counted(seen)
    done, total = counts.completed + counts.failed, counts.planned - counts.cancelled
    return Standing(headline(name, seen), done, total, counts.failures)


def line(name: str, seen: Seen) -> str:
    """How far they came."""
    counts = counted(seen)
    done = counts.completed + counts.failed
    episodes = so_many(counts.planned - counts.cancelled, "episode")
    failures = so_many(counts.failures, "failure")
    return f"{headline(name, seen)}: {done}/{episodes}, {failures}"


def headline(name: str, seen: Seen) -> str:
    """How many of them are at rest."""
    resting = [campaign for campaign in seen if campaign and campaign.state in AT_REST]
    paused = sum(campaign.state == "paused" for campaign in resting)
    rests = f", {paused} paused" if paused else ""
    return f"{name}: {len(resting) - paused} of {so_many(len(seen), 'campaign')} over{rests}"


def so_many(count: int, noun: str) -> str:
    """1 failure, 2 failures."""
    return f"{count} {noun}{'' if count == 1 else 's'}"


def counted(seen: Seen) -> Counts:
    """The episodes of all of them."""
    counts = [campaign.counts for campaign in seen if campaign]
    sums = {name: sum(getattr(each, name) for each in counts) for name in Counts.__struct_fields__}
    return Counts(**sums)
