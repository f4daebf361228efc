"""The hub's door: who has no key that is let in now does not get past the handshake (CURVE, ZAP).

It is kept by a thread of its own, so that no handshake holds up the hub and the hub no handshake.
"""

import time
from collections import Counter
from collections.abc import Mapping
from threading import Thread

import structlog
import zmq
from zmq.utils.monitor import recv_monitor_message

from eigenfail.wire.curve import HANDSHAKE_MS, fingerprint
from eigenfail_services.hub.guarded_router import GuardedRouter
from eigenfail_services.hub.keys import HubKeys

ASKED_AT = "inproc://zeromq.zap.01"
DOMAIN = b"hub"
LOOK_MS = 1_000
"""Between two looks into the folder of keys: after so long, who is let in no more is cut off."""

QUIET_S = 10.0
"""Between two lines on refusals of one kind."""

LOOKED_FOR = zmq.EVENT_HANDSHAKE_FAILED_PROTOCOL | zmq.EVENT_MONITOR_STOPPED
ALLOWED, REFUSED = b"200", b"400"
NOT_NOW = b"300"
"""ZeroMQ says nothing then: who knocked tries again when the time for a handshake is over."""

log = structlog.get_logger()


class Refusals:
    """Says who was refused, in one line for the many of a flood."""

    def __init__(self) -> None:
        self._unsaid: Counter[str] = Counter()
        self._quiet_until_s: dict[str, float] = {}

    def note(self, reason: str, **facts: str) -> None:
        """Count one; say it unless the like was said a moment ago."""
        self._unsaid[reason] += 1
        now = time.monotonic()
        if now >= self._quiet_until_s.get(reason, 0.0):
            self._quiet_until_s[reason] = now + QUIET_S
            log.warning("worker refused", reason=reason, times=self._unsaid.pop(reason), **facts)


class Door:
    """Keeps the door of one ROUTER until that is closed; both share a context of their own.

    ZeroMQ asks whoever listens at `ASKED_AT` in the context of a socket; there can be one only.
    """

    def __init__(self, keys: HubKeys) -> None:
        self._keys = keys
        self._context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
        self._refusals = Refusals()

    def router(self) -> "zmq.Socket[bytes]":
        """A ROUTER behind the door, not bound yet. The door goes with it."""
        self._router = router = self._context.socket(zmq.ROUTER, GuardedRouter)
        router.let_in, router.cut_off = frozenset(), set()
        router.setsockopt(zmq.CURVE_SERVER, 1)
        router.setsockopt(zmq.CURVE_SECRETKEY, self._keys.secret)
        router.setsockopt(zmq.ZAP_DOMAIN, DOMAIN)
        # Without it, everybody who knows the hub's public key is let in once nobody answers here.
        router.setsockopt(zmq.ZAP_ENFORCE_DOMAIN, 1)
        router.setsockopt(zmq.HANDSHAKE_IVL, HANDSHAKE_MS)
        asked: zmq.Socket[bytes] = self._context.socket(zmq.REP)
        asked.bind(ASKED_AT)
        events = router.get_monitor_socket(LOOKED_FOR)
        Thread(target=self._keep, args=(asked, events), name="door", daemon=True).start()
        return router

    def _keep(self, asked: "zmq.Socket[bytes]", events: "zmq.Socket[bytes]") -> None:
        poller = zmq.Poller()
        poller.register(asked, zmq.POLLIN)
        poller.register(events, zmq.POLLIN)
        is_open, look_s = True, 0.0
        while is_open:
            ready = dict(poller.poll(LOOK_MS))
            if asked in ready or time.monotonic() >= look_s:
                let_in, look_s = self._look(), time.monotonic() + LOOK_MS / 1_000
            if asked in ready:
                asked.send_multipart(self._answer(asked.recv_multipart(), let_in))
            if events in ready:
                is_open = self._saw(recv_monitor_message(events)["event"])
        asked.close(linger=0)
        events.close(linger=0)
        self._context.term()

    def _look(self) -> Mapping[bytes, str] | None:
        """Who is let in now, which the hub is told before they can speak; None if nobody can say.

        Then nobody is let in, and nobody cut off.
        """
        try:
            let_in = self._keys.let_in()
        except OSError as error:
            self._refusals.note(f"the folder of keys cannot be read: {error.strerror}")
            return None
        self._router.let_in = frozenset(map(bytes.hex, let_in))
        return let_in

    def _answer(self, question: list[bytes], let_in: Mapping[bytes, str] | None) -> list[bytes]:
        """To ZeroMQ's question, as ZAP has it (RFC 27)."""
        version, request, _domain, address, _identity, mechanism, *shown = question
        if let_in is None:
            return [version, request, NOT_NOW, b"", b"", b""]
        if mechanism == b"CURVE" and self._opens(shown[0], address.decode(), let_in):
            return [version, request, ALLOWED, b"", shown[0].hex().encode(), b""]
        return [version, request, REFUSED, b"", b"", b""]

    def _opens(self, public: bytes, address: str, let_in: Mapping[bytes, str]) -> bool:
        """Whether the key that was shown is let in."""
        key, name = fingerprint(public), let_in.get(public)
        if name is None:
            self._refusals.note("its key is not allowed", key=key, address=address)
        else:
            log.info("worker let in", named=name, key=key, address=address)
        return name is not None

    def _saw(self, event: int) -> bool:
        """Whether the socket is still there after what happened to it."""
        if event == zmq.EVENT_HANDSHAKE_FAILED_PROTOCOL:
            self._refusals.note("it showed no key, or knows another hub")
        return event != zmq.EVENT_MONITOR_STOPPED
