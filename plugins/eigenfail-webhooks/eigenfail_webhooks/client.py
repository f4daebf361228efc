"""Webhooks of a service: addresses that get messages on events."""

from collections.abc import Sequence

from eigenfail.client import Client
from eigenfail.values.records import Page
from eigenfail.values.rows import Rows
from eigenfail.wire.http import read_fields
from eigenfail_webhooks import values


class Webhooks:
    """Create, list, test and delete webhooks.

    Every method raises Unauthorized without a valid key, Forbidden if the key lacks the scope
    admin, and ServiceUnreachable if no service answers.

    Args:
        client: client of the service. The plug-in is installed there, too.
    """

    def __init__(self, client: Client) -> None:
        self._link = client.link

    def create(
        self, url: str, events: Sequence[values.WebhookEvent | str] = values.EVERY_EVENT
    ) -> values.NewWebhook:
        """Create a webhook; its secret is in the answer, and can never be read again.

        Args:
            url: address to which events are sent.
            events: kinds of events: campaign.ended, analysis.finished, gate.failed.

        Raises:
            InvalidValue: the address is not a URL of a host, or a kind of event is unknown.
            Conflict: the service has as many webhooks as it may have.
        """
        wanted = read_fields({"url": url, "events": list(events)}, values.WebhookRequest)
        return self._link.post("/webhooks", values.NewWebhook, wanted)

    def list(self) -> Rows[values.Webhook]:
        """All webhooks with their last deliveries, newest first, without their secrets."""
        return self._link.pages("/webhooks", Page[values.Webhook], "before")

    def get(self, webhook: int) -> values.Webhook:
        """A webhook with its last deliveries, without its secret.

        Raises:
            NotFound: no such webhook.
        """
        return self._link.get(f"/webhooks/{webhook}", values.Webhook)

    def delete(self, webhook: int) -> values.Webhook:
        """Delete a webhook, with its secret and its deliveries; returns it as it was.

        Raises:
            NotFound: no such webhook.
        """
        return self._link.delete(f"/webhooks/{webhook}", values.Webhook)

    def test(self, webhook: int) -> values.WebhookDelivery:
        """Queue a test event for a webhook; its `deliveries` say what became of it.

        Raises:
            NotFound: no such webhook.
        """
        return self._link.post(f"/webhooks/{webhook}/test", values.WebhookDelivery)
