"""`eigenfail webhook`: add, list, test and remove webhooks, to which events are sent."""

from collections.abc import Iterable, Iterator, Sequence
from typing import Annotated

import typer

from eigenfail.cli.connection import connect_to
from eigenfail.cli.options import AsJson, Url
from eigenfail.cli.render import show, to_json
from eigenfail.client.link import wait_until
from eigenfail.errors import ServiceError
from eigenfail.hosting.folder import DEFAULT_URL
from eigenfail.presentation import tables
from eigenfail.presentation.campaigns import ID
from eigenfail.presentation.figures import format_utc
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
    show(found, as_json, *_describe_webhooks(found))


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
    show(found, as_json, _tabulate_deliveries([(webhook, found)]))
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


def _describe_webhooks(found: Sequence[values.Webhook]) -> Iterator[tables.Table]:
    """A row for each webhook, and below one for each of the last deliveries; times in UTC."""
    yield tables.tabulate(
        "Webhooks",
        found,
        tables.Reading(ID, lambda webhook: str(webhook.id)),
        tables.read_text("Url", "url"),
        tables.read_text("Events", lambda webhook: ", ".join(webhook.events)),
        tables.read_text("State", lambda webhook: "active" if webhook.active else "inactive"),
        tables.read_utc("Created", "created_ms"),
    )
    if sent := [(webhook.id, each) for webhook in found for each in webhook.deliveries]:
        yield _tabulate_deliveries(sent)


def _tabulate_deliveries(found: Iterable[tuple[int, values.WebhookDelivery]]) -> tables.Table:
    """A row for each delivery of a webhook, given by its id."""
    columns = (
        *tables.count_columns("Webhook"),
        *tables.name_columns("Event", "When", "State"),
        *tables.count_columns("Attempts", "Status"),
        *tables.name_columns("Next attempt", "Error"),
    )
    rows = (
        (
            str(webhook),
            each.kind,
            format_utc(each.created_ms),
            each.state,
            each.attempts,
            each.status,
            format_utc(each.next_ms) if each.state is values.DeliveryState.PENDING else None,
            each.problem or None,
        )
        for webhook, each in found
    )
    return tables.Table("Deliveries", columns, tuple(rows))
