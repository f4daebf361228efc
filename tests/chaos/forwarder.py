"""A carrier of whole messages between workers and the hub that loses, doubles and delays some."""

import time
from collections import Counter
from dataclasses import dataclass
from heapq import heappop, heappush
from itertools import count
from random import Random
from threading import Event, Thread
from typing import Any

import zmq

TICK_MS = 10

Frames = list[bytes]


@dataclass(frozen=True)
class Carriage:
    """What befalls a message, as shares of all messages of both directions.

    Attributes:
        lost: it never comes.
        doubled: it comes twice, the second time late.
        late: others overtake it.
        late_s: by how much it is late at most.
    """

    lost: float = 0.0
    doubled: float = 0.0
    late: float = 0.0
    late_s: float = 0.0


class Forwarder:
    """A ROUTER towards the workers; for each of them a DEALER towards the hub.

    Attributes:
        address: where workers connect to instead.
        carriage: what it does to messages; may be changed at any time.
        befell: how often it did what.
    """

    def __init__(self, hub: str, seed: int, carriage: Carriage | None = None) -> None:
        self.carriage = carriage or Carriage()
        self.befell = Counter[str]()
        self._hub, self._random = hub, Random(seed)
        self._context = zmq.Context.instance()
        self._workers = self._socket(zmq.ROUTER)
        port = self._workers.bind_to_random_port("tcp://127.0.0.1")
        self.address = f"tcp://127.0.0.1:{port}"
        self._uplinks: dict[bytes, zmq.Socket[bytes]] = {}
        self._due: list[tuple[float, int, zmq.Socket[bytes], Frames]] = []
        self._numbers = count()
        self._closing = Event()
        self._thread = Thread(target=self._serve, daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Let go of everything."""
        self._closing.set()
        self._thread.join()

    def _socket(self, kind: int) -> "zmq.Socket[bytes]":
        made: zmq.Socket[bytes] = self._context.socket(kind)
        made.setsockopt(zmq.LINGER, 0)
        return made

    def _serve(self) -> None:
        self._poller = zmq.Poller()
        self._poller.register(self._workers, zmq.POLLIN)
        while not self._closing.is_set():
            for ready, _ in self._poller.poll(TICK_MS):
                self._take(ready)
            while self._due and self._due[0][0] <= time.monotonic():
                *_, to, frames = heappop(self._due)
                to.send_multipart(frames)
        for opened in (self._workers, *self._uplinks.values()):
            opened.close()

    def _take(self, source: Any) -> None:
        frames = source.recv_multipart()
        if source is self._workers:
            self._carry(self._uplink(frames[0]), frames[1:])
        else:
            worker = next(name for name, link in self._uplinks.items() if link is source)
            self._carry(self._workers, [worker, *frames])

    def _uplink(self, worker: bytes) -> "zmq.Socket[bytes]":
        if worker not in self._uplinks:
            made = self._uplinks[worker] = self._socket(zmq.DEALER)
            made.connect(self._hub)
            self._poller.register(made, zmq.POLLIN)
        return self._uplinks[worker]

    def _carry(self, to: "zmq.Socket[bytes]", frames: Frames) -> None:
        if self._befalls("lost", self.carriage.lost):
            return
        if self._befalls("doubled", self.carriage.doubled):
            self._later(to, frames)
        if self._befalls("late", self.carriage.late):
            self._later(to, frames)
        else:
            to.send_multipart(frames)

    def _later(self, to: "zmq.Socket[bytes]", frames: Frames) -> None:
        due_s = time.monotonic() + self._random.uniform(0.0, self.carriage.late_s)
        heappush(self._due, (due_s, next(self._numbers), to, frames))

    def _befalls(self, what: str, share: float) -> bool:
        befalls = self._random.random() < share
        self.befell[what] += befalls
        return befalls
