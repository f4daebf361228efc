"""Webhooks of a service: addresses that get messages on events."""

from collections.abc import Sequence

from eigenfail.client.link import Link
from eigenfail.values import webhooks
from eigenfail.values.records import Page
from eigenfail.values.rows import Rows
from eigenfail.wire.http import read_fields


class Webhooks:
    """Create, list, test and delete webhooks.

    Every method raises Unauthorized without a valid key, Forbidden without one of the scope admin,
    and ServiceUnreachable if no service answers.
    """

    def __init__(self, link: Link) -> None:
        self._link = link

    def create(
        self, url: str, events: Sequence[webhooks.WebhookEvent | str] = webhooks.EVERY_EVENT
    ) -> webhooks.NewWebhook:
        """Create a webhook; its secret is in the answer, and can never be read again.

        Args:
            url: address to which events are sent.
            events: kinds of events: campaign.ended, analysis.finished, gate.failed.

        Raises:
            InvalidValue: the address is not a URL of a host, or a kind of event is unknown.
            Conflict: the service has as many webhooks as it may have.
        """
        wanted = read_fields({"url": url, "events": list(events)}, webhooks.WebhookRequest)
        return self._link.post("/webhooks", webhooks.NewWebhook, wanted)

    def list(self) -> Rows[webhooks.Webhook]:
        """All webhooks with their last deliveries, newest first, without their secrets."""
        return self._link.pages("/webhooks", Page[webhooks.Webhook], "before")

    def get(self, webhook: int) -> webhooks.Webhook:
        """A webhook with its last deliveries, without its secret.

        Raises:
            NotFound: no such webhook.
        """
        return self._link.get(f"/webhooks/{webhook}", webhooks.Webhook)

    def delete(self, webhook: int) -> webhooks.Webhook:
        """Delete a webhook, with its secret and its deliveries; returns it as it was.

        Raises:
            NotFound: no such webhook.
        """
        return self._link.delete(f"/webhooks/{webhook}", webhooks.Webhook)

    def test(self, webhook: int) -> webhooks.WebhookDelivery:
        """Queue a test event for a webhook; its `deliveries` say what became of it.

        Raises:
            NotFound: no such webhook.
        """
        return self._link.post(f"/webhooks/{webhook}/test", webhooks.WebhookDelivery)
