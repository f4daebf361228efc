"""`eigenfail webhook`: add, list, test and remove webhooks, to which events are sent."""

from collections.abc import Iterable, Sequence
from typing import Annotated

import typer
from rich.console import Group
from rich.markup import escape
from rich.table import Table

from eigenfail.cli.connection import connect_to
from eigenfail.cli.options import AsJson, Url
from eigenfail.cli.render import show, to_json
from eigenfail.client.link import wait_until
from eigenfail.errors import ServiceError
from eigenfail.hosting.folder import DEFAULT_URL
from eigenfail.presentation.figures import UNKNOWN, format_utc
from eigenfail.presentation.terminal import start_grid
from eigenfail_webhooks import values
from eigenfail_webhooks.client import Webhooks

POLL_S = 0.3
WAIT_S = 30.0
"""Longer than an attempt takes."""

app = typer.Typer(
    add_completion=False,
    no_args_is_help=True,
    help="Add, list, test and remove webhooks, to which events are sent.\n\n"
    "Each needs a key with the scope admin, where keys are required.",
)

WebhookId = Annotated[int, typer.Argument(metavar="ID", min=1, help="Id of a webhook.")]
Address = Annotated[
    str, typer.Argument(metavar="URL", help="Address to which events are sent, https or http.")
]
Events = Annotated[
    list[values.WebhookEvent] | None,
    typer.Option(
        "--event", metavar="EVENT", help="Kind of event to send; may be repeated. [default: all]"
    ),
]


@app.command()
def add(
    context: typer.Context,
    address: Address,
    event: Events = None,
    url: Url = DEFAULT_URL,
    as_json: AsJson = False,
) -> None:
    """Add a webhook and print its secret. It is shown only once."""
    with connect_to(context, url) as client:
        made = Webhooks(client).create(address, event or values.EVERY_EVENT)
    typer.echo(to_json(made) if as_json else _describe_new_webhook(made))


@app.command("list")
def list_webhooks(context: typer.Context, url: Url = DEFAULT_URL, as_json: AsJson = False) -> None:
    """List webhooks with their last deliveries, newest first, without their secrets."""
    with connect_to(context, url) as client:
        found = tuple(Webhooks(client).list())
    show(found, as_json, lambda: _draw_webhooks(found))


@app.command()
def remove(
    context: typer.Context, webhook: WebhookId, url: Url = DEFAULT_URL, as_json: AsJson = False
) -> None:
    """Remove a webhook, with its secret and its deliveries."""
    with connect_to(context, url) as client:
        found = Webhooks(client).delete(webhook)
    typer.echo(to_json(found) if as_json else f"Webhook {found.id} to {found.url} was removed.")


@app.command("test")
def send_test(
    context: typer.Context, webhook: WebhookId, url: Url = DEFAULT_URL, as_json: AsJson = False
) -> None:
    """Send a test event to a webhook, and wait for the first attempt.

    Exits with 3 if the attempt failed. It is repeated like any delivery.
    """
    with connect_to(context, url) as client:
        queued = Webhooks(client).test(webhook)

        def look() -> values.WebhookDelivery:
            found = Webhooks(client).get(webhook).deliveries
            return next((each for each in found if each.id == queued.id), queued)

        found = wait_until(look, _is_attempted, POLL_S, WAIT_S)
    show(found, as_json, lambda: _draw_deliveries([(webhook, found)]))
    if found.state is not values.DeliveryState.DELIVERED:
        raise ServiceError(
            f"The test event was not delivered. {found.problem}",
            "`eigenfail webhook list` shows further attempts.",
        )


def _is_attempted(delivery: values.WebhookDelivery) -> bool:
    return delivery.state is not values.DeliveryState.PENDING or bool(delivery.problem)


def _describe_new_webhook(made: values.NewWebhook) -> str:
    webhook = made.webhook
    return (
        f"Webhook {webhook.id} to {webhook.url}, for {', '.join(webhook.events)}.\n"
        f"Its secret is shown only once:\n\n{made.secret}\n\n"
        f"The receiver verifies signatures with it. Test: eigenfail webhook test {webhook.id}"
    )


def _draw_webhooks(found: Sequence[values.Webhook]) -> Group:
    """A row for each webhook, and below one for each of the last deliveries; times in UTC."""
    grid = start_grid("id", "url", "events", "state", "created", right=("id",))
    for webhook in found:
        state = "active" if webhook.active else "inactive"
        cells = (webhook.url, ", ".join(webhook.events), state, format_utc(webhook.created_ms))
        grid.add_row(str(webhook.id), *map(escape, cells))
    sent = [(webhook.id, each) for webhook in found for each in webhook.deliveries]
    return Group(grid, _draw_deliveries(sent)) if sent else Group(grid)


def _draw_deliveries(found: Iterable[tuple[int, values.WebhookDelivery]]) -> Table:
    """A row for each delivery of a webhook, given by its id."""
    names = ("webhook", "event", "when", "state", "attempts", "status", "next attempt", "error")
    grid = start_grid(*names, right=("webhook", "attempts", "status"))
    for webhook, each in found:
        is_pending = each.state is values.DeliveryState.PENDING
        cells = (
            each.kind,
            format_utc(each.created_ms),
            each.state,
            str(each.attempts),
            UNKNOWN if each.status is None else str(each.status),
            format_utc(each.next_ms) if is_pending else UNKNOWN,
            each.problem or UNKNOWN,
        )
        grid.add_row(str(webhook), *map(escape, cells))
    return grid
