"""The dispatcher: queues messages on new events, sends them, and repeats failed attempts.

Each process of the services has one; they share the deliveries by claiming them. A process that is
killed during an attempt leaves a claim that runs out, and the event is sent again, under its id:
receivers get every event at least once.
"""

import ssl
from collections.abc import Sequence
from functools import partial
from http import HTTPStatus
from threading import Event

import anyio
import structlog
from anyio.to_thread import run_sync

from eigenfail import __version__
from eigenfail.errors import EigenfailError
from eigenfail_services.store.clock import now_ms
from eigenfail_services.store.store import Store
from eigenfail_webhooks.addresses import AddressRefused, IpNetwork, read_networks, resolve_host
from eigenfail_webhooks.messages import queue_messages
from eigenfail_webhooks.outbox import ClaimedDelivery, DeliveryAttempt, Outbox
from eigenfail_webhooks.signatures import (
    ID_HEADER,
    SIGNATURE_HEADER,
    TIMESTAMP_HEADER,
    sign_message,
)
from eigenfail_webhooks.values import MAX_WEBHOOKS, DeliveryState

TURN_S = 0.5
PAUSE_S = 0.1
RETRY_S = 2.0
SLOTS = MAX_WEBHOOKS
"""Attempts at a time; a webhook has one at most, so that none waits for another one's."""

ATTEMPT_S = 15.0
"""Time limit of an attempt, from the resolution of the name to the status of the answer. [s]"""

LEASE_S = 45.0
"""Longer than an attempt and its record in the database, so that a living process keeps it."""

FIRST_RETRY_S = 5.0
RETRY_FACTOR = 4
LONGEST_RETRY_S = 6 * 3_600.0
MAX_ATTEMPTS = 10
"""Most attempts of a delivery; their delays add up to 19.6 hours."""

DEFAULT_PORTS = {"http": 80, "https": 443}

log = structlog.get_logger()


def find_retry_s(attempt: int) -> float:
    """Return the delay after a failed attempt: 5 s, and four times as long each time, up to 6 h.

    Args:
        attempt: number of the attempt that failed, from 1.
    """
    return float(min(FIRST_RETRY_S * RETRY_FACTOR ** (attempt - 1), LONGEST_RETRY_S))


def judge_status(status: int, attempt: int) -> DeliveryAttempt:
    """Return the outcome of an attempt that was answered.

    Args:
        status: HTTP status of the answer.
        attempt: number of the attempt, from 1.
    """
    if 200 <= status < 300:
        return DeliveryAttempt(DeliveryState.DELIVERED, status)
    if status == HTTPStatus.GONE:
        problem = "The receiver answered 410 Gone; the webhook was deactivated."
        return DeliveryAttempt(DeliveryState.FAILED, status, problem, deactivates=True)
    hint = "; redirects are not followed" if 300 <= status < 400 else ""
    return judge_failure(f"The receiver answered {status}{hint}.", attempt, status)


def judge_failure(problem: str, attempt: int, status: int | None = None) -> DeliveryAttempt:
    """Return the outcome of a failed attempt: failed if it was the last attempt, otherwise pending.

    Args:
        problem: why it failed, in a sentence.
        attempt: number of the attempt, from 1.
        status: HTTP status of the answer, if there was one.
    """
    if attempt >= MAX_ATTEMPTS:
        return DeliveryAttempt(DeliveryState.FAILED, status, problem)
    retry_ms = round(1_000 * find_retry_s(attempt))
    return DeliveryAttempt(DeliveryState.PENDING, status, problem, retry_ms)


async def send_delivery(
    claimed: ClaimedDelivery, allowed: Sequence[IpNetwork], tls: ssl.SSLContext
) -> DeliveryAttempt:
    """Send a claimed delivery, and return the outcome; the body of the answer is not read.

    Args:
        claimed: the delivery, with the address and the secret of its webhook.
        allowed: networks that are permitted although they are not public.
        tls: verifies the certificate of the receiver.
    """
    import httpx2

    at_s, body = now_ms() // 1_000, claimed.payload.encode()
    try:
        url = httpx2.URL(claimed.url)
        host, port = url.raw_host.decode("ascii"), url.port or DEFAULT_PORTS[url.scheme]
        headers = {
            "host": url.netloc.decode("ascii"),
            "accept-encoding": "identity",
            "content-type": "application/json",
            "user-agent": f"eigenfail/{__version__}",
            ID_HEADER: claimed.event,
            TIMESTAMP_HEADER: str(at_s),
            SIGNATURE_HEADER: sign_message(claimed.secret, claimed.event, at_s, body),
        }
        with anyio.fail_after(ATTEMPT_S):
            address = await resolve_host(host, port, allowed)
            # Proxies and .netrc of the environment would lead elsewhere: the address is checked.
            async with (
                httpx2.AsyncClient(verify=tls, trust_env=False, timeout=ATTEMPT_S) as client,
                client.stream(
                    "POST",
                    # The name stays in the Host header and in TLS: the certificate of the receiver
                    # is for the name, not for the address.
                    url.copy_with(host=address),
                    headers=headers,
                    content=body,
                    extensions={"sni_hostname": host},
                ) as response,
            ):
                return judge_status(response.status_code, claimed.attempt)
    except AddressRefused as error:
        return judge_failure(str(error), claimed.attempt)
    except TimeoutError:
        return judge_failure(f"No answer within {ATTEMPT_S:g} s.", claimed.attempt)
    except (httpx2.HTTPError, httpx2.InvalidURL, OSError) as error:
        reason = str(error).rstrip(".") or type(error).__name__
        return judge_failure(f"The request failed: {reason}.", claimed.attempt)


def run(store: Store, stopping: Event) -> None:
    """Send messages until the event is set: a task of the services."""
    WebhookDispatcher(store, read_networks(), stopping).run()


class WebhookDispatcher:
    """Queues and sends messages.

    Args:
        store: store of the events and of the deliveries.
        allowed: networks that webhooks may lead to although they are not public.
        stopping: once it is set, attempts that are under way break off. They are made again after
            the next start.
    """

    def __init__(
        self, store: Store, allowed: Sequence[IpNetwork], stopping: Event | None = None
    ) -> None:
        self._store = store
        self._outbox = Outbox(store.database)
        self._allowed = allowed
        self._stopping = stopping or Event()
        self._in_flight = 0

    def run(self) -> None:
        """Take turns until `stopping` is set."""
        while not self._stopping.wait(TURN_S):
            try:
                self.turn()
            except* EigenfailError as errors:
                log.warning("webhooks wait for the database", problem=str(errors.exceptions[0]))
                self._stopping.wait(RETRY_S)

    def turn(self) -> None:
        """Queue messages on new events, and send all due ones that no other process is sending.

        Raises:
            StoreUnavailable: the database does not answer.
        """
        self._queue()
        if self._outbox.has_due(now_ms()):
            anyio.run(self._send_due)

    async def _send_due(self) -> None:
        # The context reads the certificates of the machine, which takes tens of milliseconds.
        tls = await run_sync(ssl.create_default_context)
        async with anyio.create_task_group() as group:
            while not self._stopping.is_set():
                # Here, too: one that answers slowly must not hold up new events for others.
                await run_sync(self._queue)
                while self._in_flight < SLOTS and (claimed := await run_sync(self._claim)):
                    self._in_flight += 1
                    group.start_soon(self._attempt, claimed, tls)
                if not self._in_flight:
                    return
                await anyio.sleep(PAUSE_S)
            group.cancel_scope.cancel()

    def _queue(self) -> None:
        queue_messages(self._store, self._outbox)

    def _claim(self) -> ClaimedDelivery | None:
        return self._outbox.claim(LEASE_S, now_ms())

    async def _attempt(self, claimed: ClaimedDelivery, tls: ssl.SSLContext) -> None:
        try:
            try:
                outcome = await send_delivery(claimed, self._allowed, tls)
            except Exception:  # such as a secret that was changed in the database
                log.exception("webhook attempt broke off", webhook=claimed.webhook)
                outcome = judge_failure("The attempt broke off; see the log.", claimed.attempt)
            await run_sync(partial(self._conclude, claimed, outcome))
        finally:
            self._in_flight -= 1

    def _conclude(self, claimed: ClaimedDelivery, outcome: DeliveryAttempt) -> None:
        named = {"webhook": claimed.webhook, "event_id": claimed.event, "attempt": claimed.attempt}
        if outcome.problem:
            log.warning("webhook failed", problem=outcome.problem, **named)
        try:
            self._outbox.conclude(claimed, outcome, now_ms())
        except EigenfailError as error:
            # The claim runs out, and the event is sent again.
            log.warning("webhook outcome not recorded", problem=str(error), **named)
