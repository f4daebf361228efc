"""Query of the offer of a worker's bridge, without waiting and without keeping a session.

The services refuse a campaign at its launch if the bridge does not offer its parts. So a worker
queries its bridge before there is a campaign, and again when the bridge comes back.
"""

import contextlib
import time
from collections.abc import Iterator
from uuid import uuid4

import msgspec
import structlog
import zmq
from zmq.utils.monitor import recv_monitor_message

from eigenfail.bridges import MAX_OFFER_BYTES, BridgeOffer, check_address
from eigenfail.errors import EpisodeError, InvalidValue
from eigenfail_workers.bridge import messages
from eigenfail_workers.bridge.connection import DELIMITER, LINGER_MS

ASK_AGAIN_S = 5.0
"""Time until a bridge that had no room for a session is asked again."""

log = structlog.get_logger()


class BridgeProbe:
    """Queries the offer of a bridge, once for each connection.

    The session for the query is closed when the answer arrives. A bridge that holds a single
    session would end the session of the worker's episodes for the query. So `update` queries the
    bridge only if `may_ask` states that no episodes run there.

    Args:
        address: address of the bridge, checked.

    Attributes:
        offer: the bridge's offer; None while it is unknown.
    """

    def __init__(self, address: str) -> None:
        self.offer: BridgeOffer | None = None
        self._session = ""
        self._is_connected = self._is_asked = False
        self._next_ask_s = 0.0
        self._socket: zmq.Socket[bytes] = zmq.Context.instance().socket(zmq.DEALER)
        self._socket.setsockopt(zmq.LINGER, LINGER_MS)
        self._socket.setsockopt(zmq.MAXMSGSIZE, messages.MAX_MESSAGE_BYTES)
        self._socket.setsockopt(zmq.IPV6, int("[" in address))
        events = zmq.EVENT_HANDSHAKE_SUCCEEDED | zmq.EVENT_DISCONNECTED
        self._monitor: zmq.Socket[bytes] = self._socket.get_monitor_socket(events)
        self._socket.connect(address)

    def update(self, *, may_ask: bool) -> bool:
        """Process incoming messages, send a due query, and return whether the offer has changed.

        Args:
            may_ask: whether no episode of this worker runs on the bridge.
        """
        before = self.offer
        for event in self._list_events():
            self._is_connected = event == zmq.EVENT_HANDSHAKE_SUCCEEDED
            self._is_asked, self.offer = False, None
            for _ in self._receive():
                pass  # What waits in the socket is of the connection that was lost.
        for data in self._receive():
            self._process_answer(data)
        # Not before a connection: hellos that wait in the queue would open sessions that nobody
        # closes.
        is_due = self._is_connected and not self._is_asked
        if is_due and may_ask and time.monotonic() >= self._next_ask_s:
            self._is_asked, self._session = True, uuid4().hex
            self._send(messages.BridgeHello(messages.PROTOCOL, self._session))
        return self.offer != before

    def close(self) -> None:
        """Disconnect."""
        self._socket.disable_monitor()
        self._monitor.close(linger=0)
        self._socket.close()

    def _process_answer(self, data: bytes) -> None:
        """Set the offer from the answer to a hello; any other message is ignored.

        A bridge that violates the protocol offers nothing that could be checked. Its campaigns are
        launched, and their episodes report the violation.
        """
        if not self._is_asked or self.offer is not None:
            return
        try:
            answer = messages.read_answer(data)
        except EpisodeError:
            return
        if isinstance(answer, messages.BridgeRefusal) and answer.full:
            self._is_asked, self._next_ask_s = False, time.monotonic() + ASK_AGAIN_S
        if isinstance(answer, messages.BridgeWelcome):
            self._send(messages.CloseRequest(self._session, 1))
            if answer.protocol == messages.PROTOCOL:
                self.offer = _bound_offer(answer.offer)

    def _send(self, request: messages.BridgeMessage) -> None:
        with contextlib.suppress(zmq.ZMQError):  # it has disconnected, which an event will say
            self._socket.send_multipart((DELIMITER, messages.encode(request)), zmq.NOBLOCK)

    def _receive(self) -> Iterator[bytes]:
        with contextlib.suppress(zmq.Again):
            while True:
                yield self._socket.recv_multipart(zmq.NOBLOCK)[-1]

    def _list_events(self) -> Iterator[int]:
        with contextlib.suppress(zmq.Again):
            while True:
                yield recv_monitor_message(self._monitor, zmq.NOBLOCK)["event"]


def _bound_offer(offer: BridgeOffer) -> BridgeOffer | None:
    """Return the offer; None if it is longer than services keep."""
    size = len(msgspec.json.encode(offer))
    if size <= MAX_OFFER_BYTES:
        return offer
    log.warning("offer of the bridge not reported", bytes=size, most=MAX_OFFER_BYTES)
    return None


def make_probe(address: str | None) -> BridgeProbe | None:
    """Return the probe of the bridge at an address; None without one that may be connected to."""
    if not address:
        return None
    try:
        return BridgeProbe(check_address(address))
    except (InvalidValue, zmq.ZMQError) as error:
        log.warning("bridge not asked", problem=str(error))
        return None
