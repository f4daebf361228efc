"""Webhooks: addresses that get messages on events, and the deliveries to them."""

from enum import StrEnum
from typing import Annotated, Any

import msgspec

from eigenfail.values.access import redact

MAX_WEBHOOKS = 50
"""Webhooks of one service: each event is written once for each of them."""

LAST_DELIVERIES = 10
"""Deliveries that a webhook is shown with."""


class WebhookEvent(StrEnum):
    """Kind of event that a webhook can get messages on."""

    CAMPAIGN_ENDED = "campaign.ended"
    ANALYSIS_FINISHED = "analysis.finished"
    GATE_FAILED = "gate.failed"


TEST_EVENT = "webhook.test"
"""Kind of the event that `eigenfail webhook test` sends, whatever a webhook is told of."""

EVERY_EVENT = tuple(WebhookEvent)


class DeliveryState(StrEnum):
    """State of a delivery."""

    PENDING = "pending"
    DELIVERED = "delivered"
    FAILED = "failed"


class WebhookDelivery(msgspec.Struct, frozen=True):
    """An event on its way to a webhook, with the outcome of the last attempt.

    Attributes:
        id: number of the delivery.
        event: id of the event, the same at each attempt and at all webhooks: `webhook-id`.
        kind: kind of the event, such as campaign.ended.
        created_ms: when the event occurred, in milliseconds since 1970.
        state: pending, delivered, or failed after the last attempt.
        attempts: number of attempts so far.
        next_ms: time of the next attempt of a pending delivery.
        status: HTTP status of the last answer; null without one.
        problem: why the last attempt failed; empty if it did not.
    """

    id: int
    event: str
    kind: str
    created_ms: int
    state: DeliveryState
    attempts: int
    next_ms: int
    status: int | None
    problem: str


class Webhook(msgspec.Struct, frozen=True):
    """A webhook without its secret, which is shown once.

    Attributes:
        id: number of the webhook.
        url: address to which events are sent.
        events: kinds of events that are sent.
        active: whether events are sent; false once the receiver has answered 410 Gone.
        created_ms: when it was created, in milliseconds since 1970.
        deliveries: the last deliveries, newest first; empty in answers to a change.
    """

    id: int
    url: str
    events: tuple[WebhookEvent, ...]
    active: bool
    created_ms: int
    deliveries: tuple[WebhookDelivery, ...] = ()


class WebhookRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Settings of a new webhook.

    Attributes:
        url: address to which events are sent, `https://` or `http://`, without user and password.
        events: kinds of events to send: campaign.ended, analysis.finished, gate.failed.
    """

    url: Annotated[
        str, msgspec.Meta(max_length=2_000, pattern=r"^https?://[^\s/?#@\\]+([/?][^\s#]*)?$")
    ]
    events: Annotated[tuple[WebhookEvent, ...], msgspec.Meta(min_length=1, max_length=20)] = (
        EVERY_EVENT
    )


class NewWebhook(msgspec.Struct, frozen=True):
    """A newly created webhook with its secret.

    Attributes:
        webhook: the webhook.
        secret: what signs its deliveries, `whsec_` and base64: shown this once, and never again.
    """

    webhook: Webhook
    secret: str

    def __repr__(self) -> str:
        """Without the secret."""
        return f"NewWebhook(webhook={self.webhook!r}, secret={redact(self.secret)!r})"

    def __rich_repr__(self) -> list[tuple[str, Any]]:
        """The same for those who print with colours."""
        return [("webhook", self.webhook), ("secret", redact(self.secret))]
