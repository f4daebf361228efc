"""The hub's socket: binding it, authenticating workers, sending to them and waiting for them."""

import os
import time
from collections import Counter
from collections.abc import Callable, Collection, Mapping, Sequence
from math import ceil
from pathlib import Path
from threading import Thread
from typing import Any

import structlog
import zmq
from zmq.utils.monitor import recv_monitor_message

from eigenfail.addresses import TRUST_VARIABLE, is_own_endpoint
from eigenfail.errors import InvalidValue, PortTaken, ProtocolError
from eigenfail.wire import messages
from eigenfail.wire.keys import HANDSHAKE_MS, abbreviate_key
from eigenfail_services.hub.keys import FIELD, HubKeys, KeyFolder, unusable_folder

KEYS_VARIABLE = "EIGENFAIL_HUB_KEYS"

HIGH_WATER_MARK = 2 * messages.MAX_MESSAGE_BYTES // messages.PIECE_BYTES
"""Frames that may wait for one worker: the longest message in pieces, and others."""

USER_ID = "User-Id"
"""Property of a message in which ZeroMQ hands on the authenticator's answer about its sender."""

KEY_DIGITS = 12
"""Number of hexadecimal digits of a key in lists and logs."""

CUT_OFF = messages.encode(messages.Goodbye("Its key is not accepted any more."))

ZAP_ENDPOINT = "inproc://zeromq.zap.01"
"""Where ZeroMQ asks about a key: one address for each context, by ZAP (RFC 27)."""

ZAP_DOMAIN = b"hub"
ACCEPTED, REFUSED = b"200", b"400"
TEMPORARY_FAILURE = b"300"
"""ZeroMQ does not answer the worker then, which tries again after the time for a handshake."""

KEYS_INTERVAL_MS = 1_000
"""Time between two reads of the key folder, after which a revoked key is cut off."""

LOG_INTERVAL_S = 10.0
"""Time between two log lines on refusals for the same reason."""

MONITORED_EVENTS = zmq.EVENT_HANDSHAKE_FAILED_PROTOCOL | zmq.EVENT_MONITOR_STOPPED

HEARTBEAT_ACK = messages.Ack(0, ())
"""Answer to a heartbeat, and probe of a silent worker's connection."""

UNSENT = frozenset({zmq.EAGAIN, zmq.EHOSTUNREACH})

MIN_INTERVAL_S = 0.025
"""Time between the ends of two waits, so that all that comes meanwhile is handled in one turn: a
turn of the hub costs as much for one message as for ten, and takes a core from an episode."""

QUIET_HEARTBEATS = 1.5
"""Silence after which a worker's connection is probed, in heartbeats."""

PROBE_INTERVAL_S = 0.25

GRACE_S = 1.0
"""Time for a worker to come back by another connection: it connects again within 0.2 s, is refused
at its next heartbeat, and sends a hello at once."""

Sockets = Sequence["zmq.Socket[bytes]"]

IsConnected = Callable[[bytes], bool]
"""Returns whether a worker's connection is open."""

log = structlog.get_logger()


class Router(zmq.Socket[bytes]):
    """A ROUTER whose messages have one frame each, after the identity of their connection."""

    def receive(self) -> tuple[bytes, bytes]:
        """Return the connection and the last frame of the next message.

        Raises:
            zmq.Again: there is none.
        """
        connection = self.recv(zmq.NOBLOCK)
        return connection, self._receive_last().bytes

    def _receive_last(self) -> zmq.Frame:
        """Return the last frame of a message, whose connection was received."""
        # A frame knows whether others follow: asking the socket takes as long as receiving it.
        while (frame := self.recv(zmq.NOBLOCK, copy=False)).more:
            pass
        return frame


class AuthenticatedRouter(Router):
    """A ROUTER that receives from and sends to workers only while their keys are accepted.

    ZeroMQ checks a key in the handshake only, and cannot close a connection. A worker that gets no
    answer connects again after a while, and is refused then.

    Attributes:
        accepted: the accepted keys, in hexadecimal digits.
        cut_off: connections whose keys are not accepted any more.
    """

    accepted: Collection[str]
    cut_off: set[bytes]

    def receive(self) -> tuple[bytes, bytes]:
        """Return the next message, or a goodbye in its place if its sender's key is refused.

        Raises:
            zmq.Again: there is none.
        """
        sender = self.recv(zmq.NOBLOCK)
        frame = self._receive_last()
        key = str(frame.get(USER_ID))
        if key in self.accepted:
            self.cut_off.discard(sender)
            return sender, frame.bytes
        if sender not in self.cut_off:
            self.cut_off.add(sender)
            log.warning("worker disconnected", key=key[:KEY_DIGITS])
        return sender, CUT_OFF

    def send_multipart(self, parts: Sequence[bytes], flags: int = 0, **_: Any) -> None:  # type: ignore[override]
        """Send a message, unless its receiver is cut off."""
        # It gets no answer to its heartbeats either, so that it connects again and is refused.
        if parts[0] not in self.cut_off:
            super().send_multipart(parts, flags)


class RefusalLog:
    """Logs refused workers: one line for the many refusals of a flood."""

    def __init__(self) -> None:
        self._unlogged: Counter[str] = Counter()
        self._quiet_until_s: dict[str, float] = {}

    def add(self, reason: str, **facts: str) -> None:
        """Count a refusal, and log all of this reason unless there was a line a moment ago."""
        self._unlogged[reason] += 1
        now_s = time.monotonic()
        if now_s >= self._quiet_until_s.get(reason, 0.0):
            self._quiet_until_s[reason] = now_s + LOG_INTERVAL_S
            # Refusals since the last line are counted in this one.
            times = self._unlogged.pop(reason)
            log.warning("worker refused", reason=reason, times=times, **facts)


class ZapAuthenticator:
    """Answers ZeroMQ's questions about the keys of connecting workers (CURVE, ZAP).

    It runs in a separate thread, so that handshakes and the hub do not delay each other. Its router
    has a separate context, as each context can have only one authenticator.
    """

    def __init__(self, keys: HubKeys) -> None:
        self._keys = keys
        self._context: Any = zmq.Context()
        self._refusals = RefusalLog()

    def open_router(self) -> Router:
        """Return a ROUTER that is not bound yet; closing it ends the authenticator."""
        router: AuthenticatedRouter = self._context.socket(zmq.ROUTER, AuthenticatedRouter)
        self._router = router
        router.accepted, router.cut_off = frozenset(), set()
        router.setsockopt(zmq.CURVE_SERVER, 1)
        router.setsockopt(zmq.CURVE_SECRETKEY, self._keys.secret)
        router.setsockopt(zmq.ZAP_DOMAIN, ZAP_DOMAIN)
        # Without it, every worker with the hub's public key gets in once this thread has died.
        router.setsockopt(zmq.ZAP_ENFORCE_DOMAIN, 1)
        router.setsockopt(zmq.HANDSHAKE_IVL, HANDSHAKE_MS)
        questions: zmq.Socket[bytes] = self._context.socket(zmq.REP)
        questions.bind(ZAP_ENDPOINT)
        events = router.get_monitor_socket(MONITORED_EVENTS)
        Thread(target=self._serve, args=(questions, events), name="zap", daemon=True).start()
        return router

    def _serve(self, questions: "zmq.Socket[bytes]", events: "zmq.Socket[bytes]") -> None:
        poller = zmq.Poller()
        poller.register(questions, zmq.POLLIN)
        poller.register(events, zmq.POLLIN)
        is_open, next_read_s = True, 0.0
        while is_open:
            ready = dict(poller.poll(KEYS_INTERVAL_MS))
            # Read again for each question, so that a key made a moment ago opens the door at
            # once.
            if questions in ready or time.monotonic() >= next_read_s:
                accepted = self._read_keys()
                next_read_s = time.monotonic() + KEYS_INTERVAL_MS / 1_000
            if questions in ready:
                questions.send_multipart(self._answer(questions.recv_multipart(), accepted))
            if events in ready:
                event = recv_monitor_message(events)["event"]
                if event == zmq.EVENT_HANDSHAKE_FAILED_PROTOCOL:
                    self._refusals.add("no key, or the key of another hub")
                is_open = event != zmq.EVENT_MONITOR_STOPPED
        questions.close(linger=0)
        events.close(linger=0)
        self._context.term()

    def _read_keys(self) -> Mapping[bytes, str] | None:
        """Return the accepted keys, and hand them to the router before their workers can speak.

        If the folder cannot be read, the answer is None: no worker is accepted, and none cut off.
        """
        try:
            accepted = self._keys.list_accepted()
        except OSError as error:
            self._refusals.add(f"the folder of keys cannot be read: {error.strerror}")
            return None
        self._router.accepted = frozenset(map(bytes.hex, accepted))
        return accepted

    def _answer(self, question: list[bytes], accepted: Mapping[bytes, str] | None) -> list[bytes]:
        version, request, _domain, address, _identity, mechanism, *credentials = question
        if accepted is None:
            return [version, request, TEMPORARY_FAILURE, b"", b"", b""]
        if mechanism == b"CURVE" and self._accepts(credentials[0], address.decode(), accepted):
            return [version, request, ACCEPTED, b"", credentials[0].hex().encode(), b""]
        return [version, request, REFUSED, b"", b"", b""]

    def _accepts(self, public: bytes, address: str, accepted: Mapping[bytes, str]) -> bool:
        key, name = abbreviate_key(public), accepted.get(public)
        if name is None:
            self._refusals.add("its key is not accepted", key=key, address=address)
        else:
            log.info("worker authenticated", named=name, key=key, address=address)
        return name is not None


def load_keys(address: str, folder: Path | None) -> HubKeys | None:
    """Return the keys for listening on an address; None if it needs none.

    Raises:
        InvalidValue: the folder holds no keys; or a folder is not given, although other machines
            can reach the address over a network that is not declared to be private.
    """
    if folder is not None:
        try:
            return HubKeys(KeyFolder(folder))
        except OSError as error:
            raise unusable_folder(folder, error) from error
    if not is_own_endpoint(address) and os.environ.get(TRUST_VARIABLE) != "1":
        raise InvalidValue(
            "hub",
            f"'{address}' can be reached from other machines, and there are no keys for workers.",
            f"Make keys with `eigenfail worker key create` and name their folder with {FIELD}; "
            f"or listen on tcp://127.0.0.1:PORT. On a private network, {TRUST_VARIABLE}=1 does "
            "without keys and encryption.",
        )
    return None


def bind(address: str, keys: HubKeys | None = None) -> Router:
    """Return a ROUTER at the address; with keys, only workers with accepted ones can reach it.

    Raises:
        PortTaken: it cannot be bound.
    """
    context: Any = zmq.Context.instance()
    router: Router = (
        ZapAuthenticator(keys).open_router() if keys else context.socket(zmq.ROUTER, Router)
    )
    # ZeroMQ allocates a frame as soon as its length is announced, before the peer is authenticated.
    router.setsockopt(zmq.MAXMSGSIZE, messages.MAX_FRAME_BYTES)
    router.setsockopt(zmq.SNDHWM, HIGH_WATER_MARK)
    router.setsockopt(zmq.LINGER, 1_000)
    # Without it, messages to a closed connection are dropped silently, and no probe would notice.
    router.setsockopt(zmq.ROUTER_MANDATORY, 1)
    try:
        router.bind(address)
    except zmq.ZMQError as error:
        router.close()
        raise PortTaken(f"{address} cannot be bound: {error}.", "Choose another port.") from error
    return router


def send(router: Any, worker: bytes, message: messages.Message) -> None:
    """Send a message to a worker, at once or never.

    The message is dropped if the worker's connection is closed or has taken no messages for long. A
    message that is longer than any worker accepts is dropped with a line in the log.
    """
    try:
        _try_send(router, worker, message)
    except ProtocolError as error:
        log.error("message not sent", kind=type(message).__name__, problem=str(error))  # noqa: TRY400 - the text says it all


def is_connected(router: Any, worker: bytes) -> bool:
    """Return whether a worker's connection is open, by sending it a message without effect.

    The system of a killed process closes its connections at once, and ZeroMQ forgets them. The
    connection of a slow or stopped process stays open. The connection of a lost machine stays open
    for long, too.
    """
    return _try_send(router, worker, HEARTBEAT_ACK) != zmq.EHOSTUNREACH


def _try_send(router: Any, worker: bytes, message: messages.Message) -> int:
    """Send a message; return the reason why that was not possible, or 0."""
    try:
        for frame in messages.split(message):
            router.send_multipart([worker, frame], zmq.NOBLOCK)
    except zmq.ZMQError as error:
        if error.errno not in UNSENT:
            raise
        return error.errno
    return 0


class _CachedPoller:
    """A poller that is built again only when its sockets change."""

    def __init__(self) -> None:
        self._poller = zmq.Poller()
        self._sockets: Sockets = ()

    def poll(self, sockets: Sockets, timeout_ms: int) -> bool:
        """Wait until one of the sockets can be read; return whether one can."""
        if sockets != self._sockets:
            self._sockets, self._poller = sockets, zmq.Poller()
            for socket in sockets:
                self._poller.register(socket, zmq.POLLIN)
        return bool(self._poller.poll(timeout_ms))


class Poller:
    """Waits for messages: urgent ones end a wait at once, all others together after a while."""

    def __init__(self) -> None:
        self._urgent, self._all = _CachedPoller(), _CachedPoller()
        self._next_s = 0.0

    def wait(self, patient: Sockets, urgent: Sockets, timeout_ms: int) -> None:
        """Wait until one of the sockets can be read, but hardly longer than the timeout."""
        apart_s = max(0.0, self._next_s - time.monotonic())
        if not self._is_urgent(urgent, apart_s):
            self._all.poll([*patient, *urgent], timeout_ms)
        self._next_s = time.monotonic() + MIN_INTERVAL_S

    def _is_urgent(self, urgent: Sockets, within_s: float) -> bool:
        if urgent:
            return self._urgent.poll(urgent, ceil(1_000 * within_s))
        time.sleep(within_s)  # a poller without sockets would not wait
        return False


class ConnectionProbe:
    """Finds workers whose connections are closed.

    Args:
        is_connected: returns whether a worker's connection is open, by sending it a message.
    """

    def __init__(self, is_connected: IsConnected) -> None:
        self._is_connected = is_connected
        self._closed_at_s: dict[bytes, float] = {}
        self._next_probe_s = 0.0

    def find_closed(self, quiet: Collection[bytes], now_s: float) -> list[bytes]:
        """Return the quiet workers whose connections have been closed for `GRACE_S`."""
        if now_s < self._next_probe_s:
            return []
        self._next_probe_s = now_s + PROBE_INTERVAL_S
        self._closed_at_s = {
            # A closed connection is not probed again: a worker that comes back has a new one.
            worker: self._closed_at_s.get(worker, now_s)
            for worker in quiet
            if worker in self._closed_at_s or not self._is_connected(worker)
        }
        return [worker for worker, at_s in self._closed_at_s.items() if now_s - at_s >= GRACE_S]
