"""The page of webhooks and of the newest deliveries to them."""

from collections.abc import Iterator, Mapping
from http import HTTPStatus

import msgspec
from fastapi import APIRouter
from fastapi.responses import HTMLResponse

from eigenfail.presentation.figures import UNKNOWN
from eigenfail.values.webhooks import (
    EVERY_EVENT,
    MAX_WEBHOOKS,
    DeliveryState,
    Webhook,
)
from eigenfail_api.dashboard.rendering import Badge, page, write_time
from eigenfail_api.parameters import Stored
from eigenfail_services.store.outbox import DeliverySummary

router = APIRouter(include_in_schema=False, default_response_class=HTMLResponse)

DELIVERIES = 50
"""Newest deliveries on the page, of all webhooks together."""

ACTIVE = Badge("active", "✓", "good")
INACTIVE = Badge("inactive", "‖", "ended")

BADGES = {
    DeliveryState.PENDING: Badge("pending", "○", "waiting"),
    DeliveryState.DELIVERED: Badge("delivered", "✓", "good"),
    DeliveryState.FAILED: Badge("failed", "×", "bad"),
}


class WebhookLine(msgspec.Struct, frozen=True, kw_only=True):
    """A webhook in the table, with the numbers of its deliveries that are kept, by state."""

    id: int
    url: str
    events: tuple[str, ...]
    active: bool
    badge: Badge
    pending: int
    delivered: int
    failed: int


class DeliveryLine(msgspec.Struct, frozen=True, kw_only=True):
    """A delivery in the table; `outcome` is that of the last attempt."""

    id: int
    webhook: int
    kind: str
    badge: Badge
    created: str
    attempts: int
    following: str
    outcome: str


class WebhooksView(msgspec.Struct, frozen=True, kw_only=True):
    """The page of webhooks.

    Attributes:
        kinds: kinds of events that a webhook can be told of.
        deliveries: the newest ones of all webhooks.
    """

    lines: tuple[WebhookLine, ...]
    deliveries: tuple[DeliveryLine, ...]
    kinds: tuple[str, ...] = tuple(kind.value for kind in EVERY_EVENT)


def make_webhook_line(webhook: Webhook, counts: Mapping[DeliveryState, int]) -> WebhookLine:
    """Return the line of a webhook with the numbers of its deliveries."""
    return WebhookLine(
        id=webhook.id,
        url=webhook.url,
        events=tuple(event.value for event in webhook.events),
        active=webhook.active,
        badge=ACTIVE if webhook.active else INACTIVE,
        **{state.value: counts.get(state, 0) for state in DeliveryState},
    )


def make_delivery_line(delivery: DeliverySummary) -> DeliveryLine:
    """Return the line of a delivery."""
    is_pending = delivery.state is DeliveryState.PENDING
    return DeliveryLine(
        id=delivery.id,
        webhook=delivery.webhook,
        kind=delivery.kind,
        badge=BADGES[delivery.state],
        created=write_time(delivery.created_ms),
        attempts=delivery.attempts,
        following=write_time(delivery.next_ms) if is_pending else UNKNOWN,
        outcome=" ".join(_describe_outcome(delivery)) or UNKNOWN,
    )


def _describe_outcome(delivery: DeliverySummary) -> Iterator[str]:
    if delivery.problem:
        yield delivery.problem
    elif delivery.status is not None:
        known = {status.value: status.phrase for status in HTTPStatus}
        yield f"{delivery.status} {known.get(delivery.status, '')}".strip()


@router.get("/webhooks")
def show_webhooks(store: Stored) -> HTMLResponse:
    """Webhooks, the form for a new one, and the newest deliveries."""
    counts = store.webhooks.outbox.count_by_state()
    listed = store.webhooks.page(MAX_WEBHOOKS).items
    newest = store.webhooks.outbox.newest(DELIVERIES)
    view = WebhooksView(
        lines=tuple(make_webhook_line(each, counts.get(each.id, {})) for each in listed),
        deliveries=tuple(map(make_delivery_line, newest)),
    )
    return page("webhooks.html", view)
