"""A bad line to the hub, or to the API: TCP that is cut, mute, slow or bent."""

import socket
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from enum import StrEnum
from math import inf
from random import Random
from threading import Event, Thread

CHUNK_BYTES = 4096
HOST = "127.0.0.1"


class Way(StrEnum):
    """The direction in which bytes go."""

    UP = "up"
    """From whoever connects: a worker, a client."""
    DOWN = "down"


@dataclass(frozen=True)
class Line:
    """What befalls a chunk of at most `CHUNK_BYTES` on its way; shares are of all chunks.

    Attributes:
        cut: after half of the chunk the connection is closed.
        mute: this one direction says nothing for `mute_s`; the other one goes on.
        bent: one byte is another.
        delay_s: how late every chunk comes.
        bytes_per_s: how many pass.
    """

    cut: float = 0.0
    mute: float = 0.0
    mute_s: float = 0.0
    bent: float = 0.0
    delay_s: float = 0.0
    bytes_per_s: float = inf


class Proxy:
    """Takes connections on a port of its own and passes on what comes.

    Attributes:
        address: where to connect to instead.
        line: what it does to bytes; may be changed at any time.
        befell: how often it did what.
        passed: chunks that came, by their direction.
    """

    def __init__(self, address: str, seed: int, line: Line | None = None) -> None:
        self.line = line or Line()
        self.befell = Counter[str]()
        self.passed = Counter[Way]()
        scheme, _, port = address.rpartition(":")
        self._port, self._seed = int(port), seed
        self._open = {way: Event() for way in Way}
        self._closing = Event()
        self._connections: list[tuple[socket.socket, socket.socket]] = []
        self._threads: list[Thread] = []
        self._severed = False
        self._lost_below = 0
        self._listener = socket.create_server((HOST, 0))
        self.address = f"{scheme}:{self._listener.getsockname()[1]}"
        for way in Way:
            self._open[way].set()
        self._start(self._accept)

    @contextmanager
    def muted(self, *ways: Way) -> Iterator[None]:
        """Meanwhile nothing passes in these directions; what was said comes afterwards."""
        for way in ways:
            self._open[way].clear()
        try:
            yield
        finally:
            for way in ways:
                self._open[way].set()

    @contextmanager
    def severed(self) -> Iterator[None]:
        """Meanwhile nobody is connected: who tries is sent away."""
        self._severed = True
        self.cut()
        try:
            yield
        finally:
            self._severed = False

    def lose(self) -> None:
        """As a firewall that has forgotten them: connections stay, and nothing passes any more."""
        self._lost_below = len(self._connections)

    def cut(self) -> None:
        """Close the connections that there are."""
        for ends in self._connections:
            hang_up(*ends)

    def close(self) -> None:
        """Let go of everything."""
        self._closing.set()
        for opened in self._open.values():
            opened.set()
        hang_up(self._listener)
        self._threads[0].join()  # from here on there are no new ones
        self.cut()
        for thread in self._threads:
            thread.join()
        for ends in self._connections:
            for end in ends:
                end.close()

    def _start(self, target: object, *given: object) -> None:
        thread = Thread(target=target, args=given, daemon=True)  # type: ignore[arg-type]
        self._threads.append(thread)
        thread.start()

    def _accept(self) -> None:
        with suppress(OSError):
            while True:
                near, _ = self._listener.accept()
                self._connect(near, len(self._connections))
        self._listener.close()

    def _connect(self, near: socket.socket, number: int) -> None:
        if self._severed:
            near.close()
            return
        try:
            far = socket.create_connection((HOST, self._port))
        except OSError:  # nobody listens there now
            near.close()
            return
        self._connections.append((near, far))
        if self._severed:  # since it was asked above
            hang_up(near, far)
        for way, ends in ((Way.UP, (near, far)), (Way.DOWN, (far, near))):
            self._start(self._pump, way, *ends, number)

    def _pump(self, way: Way, source: socket.socket, sink: socket.socket, number: int) -> None:
        random = Random(f"{self._seed}/{number}/{way}")
        with suppress(OSError):
            while data := source.recv(CHUNK_BYTES):
                self._open[way].wait()
                self.passed[way] += 1
                if number >= self._lost_below:
                    self._pass(data, sink, random)
        hang_up(source, sink)

    def _pass(self, data: bytes, sink: socket.socket, random: Random) -> None:
        line = self.line
        if self._befalls("cut", line.cut, random):
            sink.sendall(data[: len(data) // 2])
            raise ConnectionAbortedError
        if self._befalls("mute", line.mute, random):
            self._closing.wait(line.mute_s)
        if self._befalls("bent", line.bent, random):
            data = bend(data, random)
        self._closing.wait(line.delay_s + len(data) / line.bytes_per_s)
        sink.sendall(data)

    def _befalls(self, what: str, share: float, random: Random) -> bool:
        befalls = random.random() < share
        self.befell[what] += befalls
        return befalls


def bend(data: bytes, random: Random) -> bytes:
    """The same with one byte changed."""
    place = random.randrange(len(data))
    return data[:place] + bytes([data[place] ^ random.randrange(1, 256)]) + data[place + 1 :]


def hang_up(*ends: socket.socket) -> None:
    """End connections; who waits at one of them is woken."""
    for end in ends:
        with suppress(OSError):
            end.shutdown(socket.SHUT_RDWR)
