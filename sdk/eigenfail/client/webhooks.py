"""Webhooks of a service: addresses that get messages on events, and the deliveries."""

from collections.abc import Sequence

from eigenfail.client.link import Link
from eigenfail.frames import Rows
from eigenfail.values import Page
from eigenfail.values.webhooks import (
    EVERY_EVENT,
    DeliveryState,
    NewWebhook,
    Webhook,
    WebhookDelivery,
    WebhookEvent,
    WebhookRequest,
)
from eigenfail.wire.http import read_fields


class Webhooks:
    """Create, list, test and delete webhooks.

    Every method raises Unauthorized without a valid key, Forbidden without one of the scope admin,
    and ServiceUnreachable if no service answers.
    """

    def __init__(self, link: Link) -> None:
        self._link = link

    def create(self, url: str, events: Sequence[WebhookEvent | str] = EVERY_EVENT) -> NewWebhook:
        """Create a webhook; its secret is in the answer, and can never be read again.

        Args:
            url: address to which events are sent.
            events: kinds of events: campaign.ended, analysis.finished, gate.failed.

        Raises:
            InvalidValue: the address is not a URL of a host, or a kind of event is unknown.
            Conflict: the service has as many webhooks as it may have.
        """
        wanted = read_fields({"url": url, "events": list(events)}, WebhookRequest)
        return self._link.post("/webhooks", NewWebhook, wanted)

    def list(self) -> Rows[Webhook]:
        """All webhooks, newest first, without their secrets."""
        return self._link.pages("/webhooks", Page[Webhook], "before")

    def get(self, webhook: int) -> Webhook:
        """A webhook, without its secret.

        Raises:
            NotFound: no such webhook.
        """
        return self._link.get(f"/webhooks/{webhook}", Webhook)

    def delete(self, webhook: int) -> Webhook:
        """Delete a webhook, with its secret and its deliveries; returns it as it was.

        Raises:
            NotFound: no such webhook.
        """
        return self._link.delete(f"/webhooks/{webhook}", Webhook)

    def activate(self, webhook: int) -> Webhook:
        """Send events to a webhook from now on, and the pending deliveries.

        Raises:
            NotFound: no such webhook.
        """
        return self._link.post(f"/webhooks/{webhook}/activate", Webhook)

    def deactivate(self, webhook: int) -> Webhook:
        """Send nothing to a webhook from now on; events are not kept for it.

        Raises:
            NotFound: no such webhook.
        """
        return self._link.post(f"/webhooks/{webhook}/deactivate", Webhook)

    def test(self, webhook: int) -> WebhookDelivery:
        """Queue a test event for a webhook; `delivery` says what became of it.

        Raises:
            NotFound: no such webhook.
        """
        return self._link.post(f"/webhooks/{webhook}/test", WebhookDelivery)

    def deliveries(
        self, webhook: int, state: DeliveryState | str | None = None
    ) -> Rows[WebhookDelivery]:
        """Deliveries of a webhook, newest first.

        Args:
            webhook: id of the webhook.
            state: only those that are pending, delivered or failed.

        Raises:
            NotFound: no such webhook.
            InvalidValue: no such state.
        """
        params = None if state is None else {"state": str(state)}
        path = f"/webhooks/{webhook}/deliveries"
        return self._link.pages(path, Page[WebhookDelivery], "before", params)

    def delivery(self, webhook: int, delivery: int) -> WebhookDelivery:
        """A delivery of a webhook.

        Raises:
            NotFound: no such webhook or delivery.
        """
        return self._link.get(f"/webhooks/{webhook}/deliveries/{delivery}", WebhookDelivery)

    def redeliver(self, webhook: int, delivery: int) -> WebhookDelivery:
        """Queue a delivery again, under the same event id.

        Raises:
            NotFound: no such webhook or delivery.
        """
        path = f"/webhooks/{webhook}/deliveries/{delivery}/redeliver"
        return self._link.post(path, WebhookDelivery)
