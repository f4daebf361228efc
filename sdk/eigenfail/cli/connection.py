"""The service of a command: one at an address, one that runs, or one that the command starts."""

import os
import shlex
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, NamedTuple

import httpx2
import typer
from msgspec.structs import replace

from eigenfail import functions
from eigenfail.bridges import ADDRESS_OPTION, ADDRESS_VARIABLE
from eigenfail.cli.render import skip_check
from eigenfail.cli.specs import check_local_bridge, check_plugins
from eigenfail.client import Client
from eigenfail.client.link import check_during_waits
from eigenfail.errors import InvalidValue, ServiceUnreachable
from eigenfail.hosting.folder import DEFAULT_DATA, DEFAULT_URL, DataFolder
from eigenfail.hosting.processes import interruptible
from eigenfail.hosting.service import Plan, local_service
from eigenfail.suites import Suite, list_references, replace_references
from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail.wire.http import make_error
from eigenfail.worlds import world_of


@dataclass(frozen=True)
class Environment:
    """How the command line reaches a service."""

    connect: Callable[[str], Client] = Client


def connect_to(context: typer.Context, url: str) -> Client:
    """A client of the service at an address.

    Raises:
        InvalidValue: it is not an address.
    """
    url = find_address(context, url)
    # Tests and programs put a service of their own process in its place.
    surroundings = context.find_object(Environment) or Environment()
    try:
        return surroundings.connect(url)
    except (httpx2.InvalidURL, ValueError) as error:
        raise InvalidValue("url", f"'{url}' is not an address: {error}.") from error


def find_address(context: typer.Context, url: str) -> str:
    """The address that was asked for, or else that of the service that runs on the data folder.

    So `eigenfail up --port 0` is found by commands that are called from the same place.

    Raises:
        ServiceUnreachable: a data folder was named, and no service runs on it. Results of another
            folder would look like its own.
    """
    if url not in {"", DEFAULT_URL} or not _is_default(context, "url"):
        return url
    named = os.environ.get("EIGENFAIL_DATA")
    folder = DataFolder(context.params.get("data") or Path(named or DEFAULT_DATA))
    if running := folder.address():
        return running.url
    if named:
        raise ServiceUnreachable(
            f"No service runs on {folder.path}, the folder that EIGENFAIL_DATA names.",
            "Start one with 'eigenfail up', unset EIGENFAIL_DATA, or name a service with --url.",
        )
    return DEFAULT_URL


def _is_default(context: typer.Context, option: str) -> bool:
    """Return whether an option was set neither on the command line nor in the environment."""
    source = context.get_parameter_source(option)
    return source is None or source.name == "DEFAULT"


def this_command() -> str:
    """The command that was given, to be given again."""
    return shlex.join(["eigenfail", *sys.argv[1:]])


MaybeUrl = Annotated[
    str | None,
    typer.Option("--url", envvar="EIGENFAIL_URL", help="A service that runs already."),
]


class Place(NamedTuple):
    """A service to run on; `check` raises if it is in trouble, `again` starts it another time."""

    url: str
    check: Callable[[], None] = skip_check
    again: str = ""


@contextmanager
def connect_for_campaign(
    context: typer.Context, spec: CampaignSpec, url: str | None, plan: Plan
) -> Iterator[tuple[Client, Place]]:
    """A client of `open_place`; Ctrl-C reaches the block as KeyboardInterrupt.

    Raises:
        ServiceUnreachable: nothing answers at the address that was asked for.
    """
    with (
        interruptible(),
        open_place(context, spec, url, plan) as place,
        connect_to(context, place.url) as client,
    ):
        is_unused = not place.again and ADDRESS_VARIABLE in os.environ
        if is_unused and world_of(spec.simulator).needs_bridge:
            typer.echo(
                f"{ADDRESS_VARIABLE} has no effect here: the service at {place.url} runs already, "
                "and has bridges from its own workers. Start a worker for yours with `eigenfail "
                f"worker --connect HUB {ADDRESS_OPTION} ADDRESS`, or let this command start a "
                "service of its own with `--data FOLDER`.",
                err=True,
            )
        yield client, place


@contextmanager
def connect_for_suite(
    context: typer.Context, suite: Suite, url: str | None, plan: Plan
) -> Iterator[tuple[Client, Place]]:
    """The same for a suite, of which no member is created unless all can be.

    Raises:
        ServiceUnreachable: nothing answers at the address that was asked for.
        UnknownName: a plug-in, setting or parameter that is not there.
        InvalidValue: a setting outside its bounds.
    """
    specs = [replace_references(member.spec) for member in suite.members]
    functions.allow_functions(specs)
    with connect_for_campaign(context, specs[0], url, plan) as (client, place):
        if place.again:
            for spec in specs:
                check_plugins(spec)
            check_local_bridge(specs)
        else:
            _refuse_early(client, suite)
        yield client, place


def _refuse_early(client: Client, suite: Suite) -> None:
    """Check members that name no earlier campaign; raise the first objection of the service."""
    for member, campaign in zip(suite.members, client.suites.find(suite), strict=True):
        if campaign is None and not list_references(member.spec):
            for each in client.campaigns.check(member.spec).problems:
                where = f"member '{member.name}': "
                named = replace(each, field=where + each.field, detail=where + each.detail)
                raise make_error(named)


@contextmanager
def open_place(
    context: typer.Context, spec: CampaignSpec, url: str | None, plan: Plan
) -> Iterator[Place]:
    """A service that runs, or one that is started for as long as the block lasts.

    Raises:
        ServiceUnreachable: nothing answers at the address that was asked for.
    """
    for address in (url,) if url else _list_addresses(context, plan):
        if _is_healthy(context, address):
            yield Place(address)
            return
    if url:
        raise ServiceUnreachable(
            f"No eigenfail service answers at {url}.",
            "Start one with 'eigenfail up', or omit --url to start one for this run.",
        )
    functions.allow_functions([spec])
    check_plugins(spec)
    check_local_bridge([spec])
    with local_service(plan) as service, check_during_waits(service.check):
        try:
            again = f"eigenfail up --data {plan.data}{functions.up_option()}"
            yield Place(service.address.url, service.check, again)
        except ServiceUnreachable:
            # Which of its processes ended, and why, says more than a connection that was refused.
            service.check()
            raise


def _list_addresses(context: typer.Context, plan: Plan) -> Iterator[str]:
    """Where a service may run: on the folder; elsewhere only if no folder was asked for."""
    if running := DataFolder(plan.data).address():
        yield running.url
    if _is_default(context, "data"):
        yield DEFAULT_URL


def _is_healthy(context: typer.Context, url: str) -> bool:
    """Whether a service answers there."""
    with connect_to(context, url) as client:
        return client.health()
