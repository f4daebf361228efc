"""Webhooks: addresses that get messages on events, and the secrets that sign these."""

import json
from typing import Any

from msgspec.structs import replace
from sqlalchemy import Connection, RowMapping, delete, func, insert, select

from eigenfail.errors import Conflict, NotFound
from eigenfail.values.records import Page
from eigenfail_services.store.clock import now_ms
from eigenfail_services.store.engine import Database
from eigenfail_services.store.schema import event_counter
from eigenfail_webhooks.outbox import Outbox, select_deliveries
from eigenfail_webhooks.tables import deliveries, webhooks
from eigenfail_webhooks.values import (
    LAST_DELIVERIES,
    MAX_WEBHOOKS,
    Webhook,
    WebhookDelivery,
    WebhookEvent,
    WebhookRequest,
)

# Only a claimed delivery needs the secret: what lists do not read cannot leak from them.
_SHOWN = tuple(webhooks.c[name] for name in Webhook.__struct_fields__ if name in webhooks.c)


class WebhookStore:
    """Webhooks and their deliveries. Secrets leave it with claimed deliveries alone.

    Attributes:
        outbox: deliveries that are to be made.
    """

    def __init__(self, database: Database) -> None:
        self._database = database
        self.outbox = Outbox(database)

    def create(self, request: WebhookRequest, secret: str) -> Webhook:
        """Create an active webhook.

        Raises:
            Conflict: there are as many as there may be.
        """
        made = insert(webhooks).values(
            url=request.url,
            events=json.dumps(sorted({event.value for event in request.events})),
            secret=secret,
            active=True,
            created_ms=now_ms(),
            # Events of before its creation are not sent to a webhook.
            read_through=select(event_counter.c.last).scalar_subquery(),
        )
        with self._database.writing() as connection:
            count = connection.execute(select(func.count()).select_from(webhooks)).scalar_one()
            if count >= MAX_WEBHOOKS:
                raise Conflict(
                    f"There are {count} webhooks, and a service has at most {MAX_WEBHOOKS}.",
                    "Remove one that is no longer needed: `eigenfail webhook remove ID`.",
                )
            return _to_webhook(connection.execute(made.returning(*_SHOWN)).mappings().one())

    def get(self, webhook: int) -> Webhook:
        """Return a webhook with its last deliveries, without its secret.

        Raises:
            NotFound: no such webhook.
        """
        with self._database.reading() as connection:
            query = select(*_SHOWN).where(webhooks.c.id == webhook)
            found = connection.execute(query).mappings().one_or_none()
            if found is None:
                raise _make_error(webhook)
            return _add_deliveries(connection, _to_webhook(found))

    def page(self, limit: int, before: int | None = None) -> Page[Webhook]:
        """Return webhooks with their last deliveries, newest first, with ids below `before`."""
        query = select(*_SHOWN).order_by(webhooks.c.id.desc()).limit(limit + 1)
        if before is not None:
            query = query.where(webhooks.c.id < before)
        with self._database.reading() as connection:
            found = [
                _add_deliveries(connection, _to_webhook(row))
                for row in connection.execute(query).mappings().all()
            ]
        return Page(tuple(found[:limit]), found[limit - 1].id if len(found) > limit else None)

    def delete(self, webhook: int) -> Webhook:
        """Delete a webhook with its secret and its deliveries, and return it as it was.

        Raises:
            NotFound: no such webhook.
        """
        place = webhooks.c.id == webhook
        with self._database.writing() as connection:
            # Everyone locks the webhook before its deliveries, so that no two transactions wait for
            # each other. A message that is queued meanwhile waits.
            query = select(*_SHOWN).where(place).with_for_update()
            found = connection.execute(query).mappings().one_or_none()
            if found is None:
                raise _make_error(webhook)
            connection.execute(delete(deliveries).where(deliveries.c.webhook == webhook))
            connection.execute(delete(webhooks).where(place))
        return _to_webhook(found)

    def test(self, webhook: int) -> WebhookDelivery:
        """Queue a test event for a webhook.

        Raises:
            NotFound: no such webhook.
        """
        queued = self.outbox.queue_test(webhook)
        if queued is None:
            raise _make_error(webhook)
        return queued


def _make_error(webhook: int) -> NotFound:
    return NotFound(f"Webhook {webhook} does not exist.", "`eigenfail webhook list` lists them.")


def _to_webhook(found: RowMapping) -> Webhook:
    values: dict[str, Any] = dict(found)
    events = tuple(WebhookEvent(name) for name in json.loads(values.pop("events")))
    return Webhook(events=events, **values)


def _add_deliveries(connection: Connection, webhook: Webhook) -> Webhook:
    return replace(webhook, deliveries=select_deliveries(connection, webhook.id, LAST_DELIVERIES))
