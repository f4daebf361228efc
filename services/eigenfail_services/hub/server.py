"""The hub: one ROUTER for all workers, in a thread of its own. Decisions are made elsewhere."""

import contextlib
import time
from collections.abc import Callable, Iterator
from queue import Empty, SimpleQueue
from threading import Event, Thread

import msgspec
import structlog
import zmq

from eigenfail.contracts import Store
from eigenfail.errors import ClaimLost, StoreUnavailable
from eigenfail.wire.messages import Message, encode
from eigenfail_services.bounds import NO_BOUNDS, Bounds
from eigenfail_services.hub.attendance import Attendance
from eigenfail_services.hub.binding import bind
from eigenfail_services.hub.commits import Commits
from eigenfail_services.hub.deaths import Deaths
from eigenfail_services.hub.desk import Desk
from eigenfail_services.hub.keys import HubKeys
from eigenfail_services.hub.leases import Leases
from eigenfail_services.hub.runs import Order, Run

TICK_MS = 20
MESSAGES_PER_TURN = 1_000

PARTING_S = 3.0
"""How long a hub that stops waits for those who hold episodes."""

log = structlog.get_logger()


class Ended(msgspec.Struct, frozen=True):
    """A campaign that the hub has finished with; `problem` is empty if it ran to its end.

    `because` says why it came to its end; it is empty if it was halted. `lost` if it is somebody
    else's by now.
    """

    campaign: int
    problem: str
    because: str = ""
    lost: bool = False


class Hub:
    """Runs campaigns on whatever workers there are.

    Commands come in and endings go out through queues; everything else happens in its thread.
    With keys, only workers that they let in reach it.

    Raises:
        PortTaken: another process listens on the address.
    """

    def __init__(
        self,
        store: Store,
        address: str,
        keys: HubKeys | None = None,
        learners: Bounds = NO_BOUNDS,
    ) -> None:
        self._router = bind(address, keys)
        self.address: str = self._router.getsockopt_string(zmq.LAST_ENDPOINT)
        self.ended: SimpleQueue[Ended] = SimpleQueue()
        self._store = store
        self._learners = learners
        self._leases = Leases()
        self._commits = Commits(store.episodes)
        self._desk = Desk(self._send, self._leases, self._commits)
        self._deaths = Deaths(self._leases, self._commits, store.episodes)
        self._attendance = Attendance(store.roster, self._leases.seats)
        self._runs: dict[int, Run] = {}
        self._away = False
        self._commands: SimpleQueue[Callable[[], None]] = SimpleQueue()
        self._stopping = Event()
        self._thread = Thread(target=self._serve, name="hub")

    def start(self) -> None:
        """Begin to serve."""
        self._thread.start()

    def launch(self, order: Order) -> None:
        """Run a campaign; `ended` says when it is over."""
        self._commands.put(lambda: self._launch(order))

    def halt(self, campaign: int) -> None:
        """Stop running a campaign; `ended` says when that is done."""
        self._commands.put(lambda: self._halt(Ended(campaign, "")))

    def workers(self) -> list[str]:
        """Names of the workers that are connected."""
        return [seat.name for seat in list(self._leases.seats.values())]

    def alive(self) -> bool:
        """Whether its thread runs."""
        return self._thread.is_alive()

    def stop(self) -> None:
        """Send the workers home, end the learners, commit what came, and close."""
        self._stopping.set()
        self._thread.join()

    def _serve(self) -> None:
        try:
            while not self._stopping.is_set():
                self._wait()
                self.turn()
        finally:
            self._desk.dismiss()
            self._part()
            self._close()

    def turn(self) -> None:
        """Do what is to be done now; never waits. Its own thread alone may call it."""
        self._obey()
        self._hear_workers()
        with self._patience():
            self._tend_runs()
            self._commit()
            self._deaths.count()
            self._attendance.note()
        self._desk.bury_silent()
        if not (self._away or self._commits.stuck):  # else what comes of it could not be kept
            self._desk.assign(self._runs)
        self._look()

    def _wait(self) -> None:
        poller = zmq.Poller()
        poller.register(self._router, zmq.POLLIN)
        for run in self._runs.values():
            poller.register(run.socket, zmq.POLLIN)
        poller.poll(TICK_MS)

    def _obey(self) -> None:
        with contextlib.suppress(Empty):
            while True:
                self._commands.get_nowait()()

    def _launch(self, order: Order) -> None:
        run = Run(order, self._store, self._leases, self._learners)
        self._runs[order.campaign] = run

    def _halt(self, ended: Ended) -> None:
        if run := self._runs.pop(ended.campaign, None):
            run.stop()
            self._desk.drop(ended.campaign)
            self.ended.put(ended)

    def _hear_workers(self) -> None:
        for _ in range(MESSAGES_PER_TURN):
            try:
                parts = self._router.recv_multipart(zmq.NOBLOCK)
            except zmq.Again:
                return
            self._desk.hear(parts[0], parts[-1])

    def _tend_runs(self) -> None:
        for run in list(self._runs.values()):
            try:
                run.tend()
            except ClaimLost as error:
                log.warning("campaign lost", campaign=run.order.campaign, problem=str(error))
                self._halt(Ended(run.order.campaign, "", lost=True))
            if run.ended is not None:
                self._halt(Ended(run.order.campaign, run.ended, run.because))

    def _look(self) -> None:
        """At the end of a turn: what is seen now lasts until the next one's end."""
        for run in self._runs.values():
            run.look()

    def _commit(self, *, now: bool = False) -> None:
        for committed in self._commits.flush(now=now):
            self._desk.acknowledge(committed)
            if run := self._runs.get(committed.campaign):
                run.land(committed.result, committed.verdict)

    def _send(self, worker: bytes, message: Message) -> None:
        with contextlib.suppress(zmq.Again):
            self._router.send_multipart([worker, encode(message)], zmq.NOBLOCK)

    @contextlib.contextmanager
    def _patience(self) -> Iterator[None]:
        """While the store is away nothing is lost: results wait, and so do their workers."""
        try:
            yield
            self._away = False
        except StoreUnavailable as error:
            self._away = True
            log.warning("store unavailable", problem=str(error))
            time.sleep(TICK_MS / 1_000)

    def _close(self) -> None:
        self._hear_workers()
        with self._patience():
            self._commit(now=True)
            self._attendance.close()
        for run in self._runs.values():
            run.stop()
        self._router.close()

    def _part(self) -> None:
        """Who was sent home hands over what is finished; what they run is leased anew."""
        until_s = time.monotonic() + PARTING_S
        while True:
            self._hear_workers()
            with self._patience():
                self._commit(now=True)
            someone_holds = any(seat.held for seat in self._leases.seats.values())
            if time.monotonic() >= until_s or not someone_holds:
                return
            self._router.poll(TICK_MS)
