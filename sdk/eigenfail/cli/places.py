"""Where a command runs its campaigns: on a service that runs, or on one that it starts."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Annotated, NamedTuple

import typer
from msgspec.structs import replace

from eigenfail import functions
from eigenfail.cli.options import DEFAULT_URL
from eigenfail.cli.progress import nothing_wrong
from eigenfail.cli.specs import check_plugins
from eigenfail.cli.surroundings import client_at, is_default
from eigenfail.client import Client
from eigenfail.client.waiting import watching
from eigenfail.errors import ServiceUnreachable
from eigenfail.hosting.folder import DataFolder
from eigenfail.hosting.service import Plan, local_service
from eigenfail.hosting.signals import interruptible
from eigenfail.suites import Suite
from eigenfail.suites.references import references, with_any_numbers
from eigenfail.values import CampaignSpec
from eigenfail.wire.problems import Problem, error_of

MaybeUrl = Annotated[
    str | None,
    typer.Option("--url", envvar="EIGENFAIL_URL", help="A service that runs already."),
]


class Place(NamedTuple):
    """A service to run on; `check` raises if it is in trouble, `again` starts it another time."""

    url: str
    check: Callable[[], None] = nothing_wrong
    again: str = ""


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
def client_of_suite(
    context: typer.Context, suite: Suite, url: str | None, plan: Plan
) -> Iterator[tuple[Client, Place]]:
    """The same for a suite, of which no member is created unless all can be.

    Raises:
        ServiceUnreachable: nothing answers at the address that was asked for.
        UnknownName: a plug-in, setting or parameter that is not there.
        InvalidValue: a setting outside its bounds.
    """
    specs = [with_any_numbers(member.spec) for member in suite.members]
    functions.allow_of(specs)
    with client_somewhere(context, specs[0], url, plan) as (client, place):
        if place.again:
            for spec in specs:
                check_plugins(spec)
        else:
            refuse_early(client, suite)
        yield client, place


def refuse_early(client: Client, suite: Suite) -> None:
    """Raise what a service would refuse a member for; those that build upon others come later."""
    for member, campaign in zip(suite.members, client.suites.find(suite), strict=True):
        if campaign is None and not references(member.spec):
            for problem in client.campaigns.check(member.spec).problems:
                raise error_of(inside(f"member '{member.name}': ", problem))


def inside(where: str, problem: Problem) -> Problem:
    """The problem, told of a part of the whole."""
    return replace(problem, field=where + problem.field, detail=where + problem.detail)


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
    functions.allow_of([spec])
    check_plugins(spec)
    with local_service(plan) as service, watching(service.check):
        try:
            again = f"eigenfail up --data {plan.data}{functions.up_option()}"
            yield Place(service.address.url, service.check, again)
        except ServiceUnreachable:
            # Which of its processes ended, and why, says more than that nobody answers.
            service.check()
            raise


def nearby(context: typer.Context, plan: Plan) -> Iterator[str]:
    """Where a service may run: on the folder; elsewhere only if no folder was asked for."""
    if running := DataFolder(plan.data).address():
        yield running.url
    if is_default(context, "data"):
        yield DEFAULT_URL


def is_healthy(context: typer.Context, url: str) -> bool:
    """Whether a service answers there."""
    with client_at(context, url) as client:
        return client.health()
