"""HTTP connections within bounds: of their number, of time, of tiny chunks; and no ambiguous ones.

uvicorn has no time-out for a request that is never completed, and h11 takes requests whose length
two headers state differently from each other, which is how requests are smuggled past a proxy.
"""

import asyncio
from math import inf
from typing import Any, TypeAlias

import h11
from uvicorn.protocols.http.h11_impl import H11Protocol, RequestResponseCycle

from eigenfail.wire.http import make_untyped_problem
from eigenfail_api.problems import answer

HEAD_S = 10.0
"""From the beginning of a connection, or the first byte of a request, to the end of its headers."""

BODY_S = 30.0
SLOWEST_BYTES_PER_S = 500.0
"""A body may take 30 s, and longer the larger it is: honest lines carry 8 kbit/s and more."""

DRAIN_S = 5.0
"""For a body that is still being sent after its request was answered."""

STALLED_S = 120.0
"""For a client to take any part of an answer that fills the buffers between it and the service."""

HEAD_BYTES = 16 * 1024
"""The longest head of a request, and the longest line between two chunks."""

FREE_CHUNKS = 1_000
FREE_READS = 10_000
CHUNK_BYTES = 64
"""Beyond these counts, the chunks and network reads of a body must average CHUNK_BYTES: each of
them costs the event loop as much as a large one."""

TIMED_OUT = 408
BAD_REQUEST = 400
BUSY = 503
REMEDIES = {
    BAD_REQUEST: "Send requests as in RFC 9112, and bodies in chunks of 64 bytes or more.",
    TIMED_OUT: "Send the whole request at once, faster than 4 kbit/s.",
    BUSY: "Close unused connections, or raise EIGENFAIL_MAX_CONNECTIONS.",
}

Phase: TypeAlias = tuple[object, object]


class StrictConnection(h11.Connection):
    """h11's parser, which refuses requests of ambiguous length, and bodies in tiny chunks.

    Attributes:
        problem: why something was refused; empty if nothing was.
    """

    def __init__(self, role: Any, max_incomplete_event_size: int) -> None:
        super().__init__(role, max_incomplete_event_size)
        self.problem = ""
        self._chunks = self._chunk_bytes = 0

    def next_event(self) -> Any:
        """Return the next event, as h11 does.

        Raises:
            h11.RemoteProtocolError: the peer sends data that is not accepted here.
        """
        try:
            return self._checked(super().next_event())
        except h11.RemoteProtocolError as error:
            self.problem = str(error)
            raise

    def _checked(self, event: Any) -> Any:
        if isinstance(event, h11.Request):
            self._chunks = self._chunk_bytes = 0
            refuse_ambiguous_length(event)
        elif isinstance(event, h11.Data):
            self._chunks += event.chunk_start
            self._chunk_bytes += len(event.data)
            if (self._chunks - FREE_CHUNKS) * CHUNK_BYTES > self._chunk_bytes:
                raise h11.RemoteProtocolError("The body comes in chunks that are too small.")
        return event


def refuse_ambiguous_length(request: h11.Request) -> None:
    """Refuse a request of which a proxy may believe that it ends elsewhere.

    Raises:
        h11.RemoteProtocolError: it has two lengths, or chunks in a version that knows none.
    """
    names = {name for name, _ in request.headers}
    if b"transfer-encoding" not in names:
        return
    if b"content-length" in names:
        raise h11.RemoteProtocolError("Content-Length and Transfer-Encoding exclude each other.")
    if request.http_version < b"1.1":
        raise h11.RemoteProtocolError("HTTP/1.0 does not support Transfer-Encoding.")


def make_protocol(max_connections: int) -> "type[BoundedProtocol]":
    """Return the protocol class of a server with a maximum number of open connections."""
    return type("Protocol", (BoundedProtocol,), {"max_connections": max_connections})


class BoundedProtocol(H11Protocol):
    """One HTTP connection, which is closed when it takes too long over a request.

    Attributes:
        max_connections: open at a time; see `make_protocol`.
    """

    max_connections = 500

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        limit = self.config.h11_max_incomplete_event_size
        self.conn: StrictConnection = StrictConnection(h11.SERVER, limit or HEAD_BYTES)
        self._timer: asyncio.TimerHandle | None = None
        self._phase: Phase = (None, None)
        self._began_s = self._answered_s = 0.0
        self._reads = self._read_bytes = 0
        self._write_timer: asyncio.TimerHandle | None = None
        self._unsent_bytes = 0

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Take a connection; where there are too many, the one that idles longest makes room."""
        super().connection_made(transport)
        if len(self.connections) > self.max_connections and not self._make_room():
            self._refuse(BUSY, f"{self.max_connections} connections are open.")
            return
        self._watch()

    def connection_lost(self, exc: Exception | None) -> None:
        """Forget the connection."""
        self._stop_timer()
        self._stop_write_timer()
        super().connection_lost(exc)

    def data_received(self, data: bytes) -> None:
        """Take what came, within the bounds."""
        self._watch()
        self._reads += 1
        self._read_bytes += len(data)
        super().data_received(data)
        if (self._reads - FREE_READS) * CHUNK_BYTES > self._read_bytes:
            self._refuse(BAD_REQUEST, "The body comes in pieces that are too small.")
        elif not self.transport.is_closing():
            self._watch()

    def pause_writing(self) -> None:
        """Let the application wait for a client that reads slowly, but not for ever."""
        super().pause_writing()
        self._watch_writing()

    def resume_writing(self) -> None:
        """Let the application go on."""
        self._stop_write_timer()
        super().resume_writing()

    def on_response_complete(self) -> None:
        """Go on with the next request; drain an unread body for a bounded time."""
        super().on_response_complete()
        self._answered_s = self.loop.time()
        if not self.transport.is_closing():
            self._watch()

    def send_400_response(self, msg: str) -> None:
        """Refuse what h11 could not read."""
        self._refuse(BAD_REQUEST, f"{msg} {self.conn.problem}")

    @property
    def idle_since_s(self) -> float:
        """Since when it has been waiting for a whole request; infinite while one is answered."""
        return self._began_s if self.conn.their_state is h11.IDLE else inf

    @property
    def _current(self) -> RequestResponseCycle | None:
        """The newest request; None before the first one, which uvicorn's types leave out."""
        return self.cycle

    def _make_room(self) -> bool:
        """Close the connection that has been without a whole request for longest, if there is one.

        Of a crowd that opens connections and says little, those are the ones to go.
        """
        others = [each for each in self.connections if each is not self]
        bounded = [each for each in others if isinstance(each, BoundedProtocol)]
        oldest = min(bounded, key=lambda each: each.idle_since_s, default=None)
        if oldest is None or oldest.idle_since_s == inf:
            return False
        oldest.transport.abort()
        self.connections.discard(oldest)
        return True

    def _watch(self) -> None:
        """Begin to count the time of a new phase of the connection, if it is in one."""
        phase = (self.conn.their_state, self.cycle)
        if phase != self._phase:
            self._phase, self._began_s = phase, self.loop.time()
            self._reads = self._read_bytes = 0
        self._stop_timer()
        deadline_s = self._deadline_s()
        if deadline_s < inf:
            self._timer = self.loop.call_at(deadline_s, self._look)

    def _deadline_s(self) -> float:
        """When the present phase has taken too long, by the clock of the loop."""
        if self.conn.their_state is h11.IDLE:
            return self._began_s + HEAD_S
        if self.conn.their_state is not h11.SEND_BODY:
            return inf
        deadline_s = self._began_s + BODY_S + self._read_bytes / SLOWEST_BYTES_PER_S
        if (cycle := self._current) is not None and cycle.response_complete:
            return min(deadline_s, self._answered_s + DRAIN_S)
        return deadline_s

    def _look(self) -> None:
        if self.transport.is_closing():
            return
        if self.loop.time() < self._deadline_s():
            self._watch()
            return
        if not self._read_bytes and self.conn.their_state is h11.IDLE:
            self.transport.close()  # browsers open connections ahead, and ask for nothing
            return
        self._refuse(TIMED_OUT, "The request did not arrive in time.")

    def _watch_writing(self) -> None:
        """Begin to count the time in which the client must take part of the answer."""
        self._unsent_bytes = self.transport.get_write_buffer_size()
        self._write_timer = self.loop.call_later(STALLED_S, self._look_at_writing)

    def _look_at_writing(self) -> None:
        if self.transport.get_write_buffer_size() < self._unsent_bytes:
            self._watch_writing()
        else:
            self.transport.abort()

    def _stop_write_timer(self) -> None:
        if self._write_timer is not None:
            self._write_timer.cancel()
            self._write_timer = None

    def _stop_timer(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    def _refuse(self, status: int, detail: str) -> None:
        """Say why, where nothing was answered yet, and close."""
        self._stop_timer()
        if self.transport.is_closing():
            return
        if self.conn.our_state in {h11.IDLE, h11.SEND_RESPONSE}:
            response = answer(make_untyped_problem(status, detail, remedy=REMEDIES[status]))
            body = bytes(response.body)
            if (cycle := self._current) is not None and not cycle.response_complete:
                cycle.disconnected = True  # what its application still says goes nowhere
                cycle.message_event.set()
                body = b"" if cycle.scope["method"] == "HEAD" else body
            headers = [*response.raw_headers, (b"connection", b"close")]
            head = h11.Response(status_code=status, headers=headers)
            for event in (head, h11.Data(data=body), h11.EndOfMessage()):
                self.transport.write(self.conn.send(event) or b"")
        self.transport.close()
