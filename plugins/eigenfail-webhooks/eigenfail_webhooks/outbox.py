"""The outbox: messages to webhooks, each a delivery that is claimed, attempted and concluded.

Deliveries are queued in the transaction that moves the webhooks' places in the event log forward:
after a crash, both were done or neither was. A delivery is claimed for as long as one attempt may
take; after a crash in between, another process delivers it again, under the same event id.
"""

import json
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from typing import Any, NamedTuple
from uuid import uuid4

import sqlalchemy as sa

from eigenfail_services.store.clock import LeaseClock, length_ms, now_ms
from eigenfail_services.store.engine import Database
from eigenfail_webhooks.tables import deliveries, webhooks
from eigenfail_webhooks.values import TEST_EVENT, DeliveryState, WebhookDelivery, WebhookEvent

KEPT_DELIVERIES = 20_000
"""Ended deliveries that are kept at least; older ones are deleted."""

PRUNED_EVERY = 1_000

_out = deliveries.c


class EventMessage(NamedTuple):
    """A message on an event of the core's log.

    Attributes:
        number: id of the event in the log.
        at_ms: when it occurred, in milliseconds since 1970.
        kind: kind of the message.
        data: what the message says.
    """

    number: int
    at_ms: int
    kind: WebhookEvent
    data: Mapping[str, Any]


def _insert_deliveries(
    connection: sa.Connection, told: list[int], kind: str, data: Mapping[str, Any], at_ms: int
) -> list[WebhookDelivery]:
    event = f"evt_{uuid4().hex}"
    at = datetime.fromtimestamp(at_ms / 1_000, UTC).isoformat(timespec="milliseconds")
    # Escapes of ASCII take any text, half characters included.
    payload = json.dumps({"type": kind, "timestamp": at, "data": dict(data)})
    common = {
        "event": event,
        "kind": kind,
        "payload": payload,
        "created_ms": at_ms,
        "state": DeliveryState.PENDING.value,
        "attempts": 0,
        "next_ms": at_ms,
        "problem": "",
        "lease_until_ms": 0,
        "lease_ms": 0,
    }
    made = []
    for webhook in told:
        statement = sa.insert(deliveries).values(webhook=webhook, **common)
        made.append(_to_delivery(connection.execute(statement.returning(*_SHOWN)).one()))
    if any(each.id % PRUNED_EVERY == 0 for each in made):
        ended = _out.state != DeliveryState.PENDING.value
        oldest = made[-1].id - KEPT_DELIVERIES
        connection.execute(sa.delete(deliveries).where(ended, _out.id <= oldest))
    return made


_SHOWN = tuple(_out[name] for name in WebhookDelivery.__struct_fields__)


class ClaimedDelivery(NamedTuple):
    """A delivery that one process may attempt.

    Attributes:
        id: number of the delivery.
        token: identifies the claim.
        attempt: number of this attempt, from 1.
        event: id of the event.
        payload: message to send, as JSON text.
        webhook: id of the webhook.
        url: address of the webhook.
        secret: secret of the webhook.
    """

    id: int
    token: str
    attempt: int
    event: str
    payload: str
    webhook: int
    url: str
    secret: str


class DeliveryAttempt(NamedTuple):
    """Outcome of an attempt.

    Attributes:
        state: pending if another attempt follows.
        status: HTTP status of the answer; None without one.
        problem: why it failed; empty if it did not.
        retry_ms: time until the next attempt of a pending delivery. [ms]
        deactivates: whether nothing more is to be sent to the webhook.
    """

    state: DeliveryState
    status: int | None = None
    problem: str = ""
    retry_ms: int = 0
    deactivates: bool = False


class Outbox:
    """Deliveries: queued, claimed, and concluded."""

    def __init__(self, database: Database) -> None:
        self._database = database

    def queue_test(self, webhook: int) -> WebhookDelivery | None:
        """Queue a test event for a webhook; None if the webhook does not exist."""
        lock = sa.select(webhooks.c.id).where(webhooks.c.id == webhook)
        with self._database.writing() as connection:
            found = connection.execute(lock.with_for_update(read=True, key_share=True)).first()
            if found is None:
                return None
            data = {"webhook": webhook}
            return _insert_deliveries(connection, [webhook], TEST_EVENT, data, now_ms())[0]

    def find_place(self) -> int | None:
        """Return the id of the last event that all active webhooks have had; None without any."""
        query = sa.select(sa.func.min(webhooks.c.read_through)).where(webhooks.c.active)
        with self._database.reading() as connection:
            place: int | None = connection.execute(query).scalar_one()
        return place

    def queue(self, messages: Sequence[EventMessage], through: int) -> None:
        """Queue messages for the active webhooks that want them and have not had them.

        Args:
            messages: messages in the order of the events.
            through: id of the last event that was looked at.
        """
        # The lock makes other processes wait that read the same events. They then find that the
        # webhooks have had them.
        query = (
            sa.select(webhooks.c.id, webhooks.c.events, webhooks.c.read_through)
            .where(webhooks.c.active)
            .order_by(webhooks.c.id)
            .with_for_update(key_share=True)
        )
        with self._database.writing() as connection:
            found = connection.execute(query).all()
            kinds = {row.id: json.loads(row.events) for row in found}
            for message in messages:
                told = [
                    row.id
                    for row in found
                    if row.read_through < message.number and message.kind.value in kinds[row.id]
                ]
                if told:
                    kind, data, at_ms = message.kind.value, message.data, message.at_ms
                    _insert_deliveries(connection, told, kind, data, at_ms)
            looked_at = [row.id for row in found]
            behind = webhooks.c.id.in_(looked_at), webhooks.c.read_through < through
            connection.execute(sa.update(webhooks).where(*behind).values(read_through=through))

    def has_due(self, at_ms: int) -> bool:
        """Return whether a delivery may be attempted now, or is being attempted."""
        query = sa.select(_out.id).select_from(_JOINED).where(*_is_due(at_ms)).limit(1)
        with self._database.reading() as connection:
            return connection.execute(query).first() is not None

    def claim(self, lease_s: float, at_ms: int) -> ClaimedDelivery | None:
        """Claim the delivery that has been due for longest, and return it; None without one.

        A webhook has one delivery at a time, so that a slow webhook does not delay any other.

        Args:
            lease_s: after this time another process may claim it. [s]
            at_ms: current time, in milliseconds since 1970.
        """
        with self._database.writing() as connection:
            return claim_first(connection, lease_s, at_ms)

    def conclude(self, claimed: ClaimedDelivery, attempt: DeliveryAttempt, at_ms: int) -> bool:
        """Record the outcome of an attempt, or nothing and return False if the claim was lost."""
        statement = (
            sa.update(deliveries)
            .where(_out.id == claimed.id, _out.token == claimed.token)
            .values(
                state=attempt.state.value,
                status=attempt.status,
                problem=attempt.problem,
                next_ms=at_ms + attempt.retry_ms,
                token=None,
                lease_until_ms=0,
                lease_ms=0,
            )
        )
        place = webhooks.c.id == claimed.webhook
        with self._database.writing() as connection:
            if attempt.deactivates:
                # Whoever deletes a webhook locks it before its deliveries, too.
                lock = sa.select(webhooks.c.id).where(place).with_for_update(key_share=True)
                connection.execute(lock)
            is_held = connection.execute(statement).rowcount == 1
            if is_held and attempt.deactivates:
                connection.execute(sa.update(webhooks).where(place).values(active=False))
        return is_held


_JOINED = deliveries.join(webhooks, webhooks.c.id == _out.webhook)


def _is_due(at_ms: int) -> tuple[sa.ColumnElement[bool], ...]:
    return _out.state == DeliveryState.PENDING.value, _out.next_ms <= at_ms, webhooks.c.active


def _is_leased(columns: Any) -> sa.ColumnElement[bool]:
    # A lease that is yet to begin is of another clock: of before the machine was started anew.
    begun_ms = columns.lease_until_ms - columns.lease_ms
    return sa.and_(LeaseClock() < columns.lease_until_ms, begun_ms <= LeaseClock())


def claim_first(connection: sa.Connection, lease_s: float, at_ms: int) -> ClaimedDelivery | None:
    """Claim the delivery that has been due for longest, of a webhook that has none in flight.

    Args:
        connection: a transaction that may write.
        lease_s: after this time another process may claim it. [s]
        at_ms: current time, in milliseconds since 1970.
    """
    length = length_ms(lease_s)
    lease = {"lease_until_ms": LeaseClock() + length, "lease_ms": length}
    claimed = (_out.id, _out.token, _out.attempts, _out.event, _out.payload)
    # Two statements: the second one sees what was committed before the webhook was locked, such as
    # a claim of another of its deliveries. The next turn does not find that webhook any more.
    while (target := connection.execute(_select_webhook(at_ms)).one_or_none()) is not None:
        statement = (
            sa.update(deliveries)
            .where(_out.id == _select_first(target.id, at_ms).scalar_subquery())
            .values(token=uuid4().hex, attempts=_out.attempts + 1, **lease)
            .returning(*claimed)
        )
        found = connection.execute(statement).one_or_none()
        if found is not None:
            return ClaimedDelivery(
                id=found.id,
                token=found.token,
                attempt=found.attempts,
                event=found.event,
                payload=found.payload,
                webhook=target.id,
                url=target.url,
                secret=target.secret,
            )
    return None


def _is_idle() -> sa.ColumnElement[bool]:
    other = deliveries.alias().c
    pending = DeliveryState.PENDING.value
    return _out.webhook.not_in(
        sa.select(other.webhook).where(other.state == pending, _is_leased(other))
    )


def _select_webhook(at_ms: int) -> sa.Select[int, str, str]:
    """Select and lock the webhook whose delivery has been due for longest."""
    return (
        sa.select(webhooks.c.id, webhooks.c.url, webhooks.c.secret)
        .select_from(_JOINED)
        .where(*_is_due(at_ms), _is_idle())
        .order_by(_out.next_ms, _out.id)
        .limit(1)
        # A webhook that another transaction holds gets a delivery of that one, or is changed.
        # One that queues events holds all of them: then nothing is claimed until the next turn.
        .with_for_update(of=webhooks, key_share=True, skip_locked=True)
    )


def _select_first(webhook: int, at_ms: int) -> sa.Select[int]:
    """Select and lock the delivery of a locked webhook that has been due for longest."""
    return (
        sa.select(_out.id)
        .select_from(_JOINED)
        .where(_out.webhook == webhook, *_is_due(at_ms), _is_idle())
        .order_by(_out.next_ms, _out.id)
        .limit(1)
        .with_for_update(of=deliveries, skip_locked=True)
    )


def select_deliveries(
    connection: sa.Connection, webhook: int, limit: int
) -> tuple[WebhookDelivery, ...]:
    """Return the last deliveries of a webhook, newest first."""
    query = sa.select(*_SHOWN).where(_out.webhook == webhook).order_by(_out.id.desc()).limit(limit)
    return tuple(_to_delivery(row) for row in connection.execute(query))


def _to_delivery(row: sa.Row[Any]) -> WebhookDelivery:
    values = dict(row._mapping)  # noqa: SLF001 - SQLAlchemy's public name
    return WebhookDelivery(**values | {"state": DeliveryState(values["state"])})
