"""The hub: one ROUTER for all workers, in a thread of its own. Decisions are made elsewhere."""

import contextlib
import time
from collections.abc import Callable, Collection, Iterator
from queue import Empty, SimpleQueue
from threading import Event, Thread

import structlog
import zmq

from eigenfail import bridges
from eigenfail.contracts import Store
from eigenfail.errors import ClaimLost, StoreUnavailable
from eigenfail_services.bounds import NO_BOUNDS, Bounds
from eigenfail_services.hub.attendance import Attendance
from eigenfail_services.hub.binding import bind
from eigenfail_services.hub.commits import Commits
from eigenfail_services.hub.deaths import Deaths
from eigenfail_services.hub.departures import Departures
from eigenfail_services.hub.desk import Desk
from eigenfail_services.hub.ears import Ears
from eigenfail_services.hub.ended import Ended
from eigenfail_services.hub.keys import HubKeys
from eigenfail_services.hub.leases import Leases
from eigenfail_services.hub.muster import Muster, muster
from eigenfail_services.hub.post import Post
from eigenfail_services.hub.runs import Order, Run
from eigenfail_services.hub.stranded import Stranded
from eigenfail_services.hub.vitals import Vitals, standing, timed

TICK_MS = 20
MESSAGES_PER_TURN = 1_000

PARTING_S = 3.0
"""How long a hub that stops waits for those who hold episodes."""

LOOK_EVERY_S = 1.0
"""How old what is scraped may be."""

log = structlog.get_logger()


class Hub:
    """Runs campaigns on whatever workers there are.

    Commands come in and endings go out through queues; everything else happens in its thread.
    With keys, only workers that they let in reach it.

    Attributes:
        address: where it listens.
        ended: campaigns that it has finished with.
        vitals: how it is doing.

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
        self.vitals = Vitals()
        self._commits = Commits(store.episodes, self.vitals)
        post, kept = Post(self._router), (self._leases, self._commits, self.vitals)
        self._desk = Desk(post.send, *kept, post.reaches)
        self._deaths = Deaths(self._leases, self._commits, store.episodes)
        self._attendance = Attendance(store.roster, self._leases.seats)
        self._stranded = Stranded(store.events, self._leases.stranded, self._leases.has_bridge)
        self._departures = Departures()
        self._runs: dict[int, Run] = {}
        self._away = False
        self._ears = Ears()
        self._next_look_s = 0.0
        self._commands: SimpleQueue[Callable[[], None]] = SimpleQueue()
        self._stopping = Event()
        self._thread = Thread(target=self._serve, name="hub")

    def start(self) -> None:
        """Begin to serve."""
        self._thread.start()

    def launch(self, order: Order) -> None:
        """Run a campaign; `ended` says when it is over."""
        self._commands.put(lambda: self._launch(order))

    def weigh(self, campaign: int, weight: float) -> None:
        """From now on its share of the workers' time goes by this weight, if it runs."""
        self._commands.put(lambda: self._weigh(campaign, weight))

    def halt(self, campaign: int) -> None:
        """Stop running a campaign; `ended` says when that is done."""
        self._commands.put(lambda: self._halt(Ended(campaign, "")))

    def workers(self) -> list[str]:
        """Names of the workers that are connected."""
        return [seat.name for seat in list(self._leases.seats.values())]

    def muster(self) -> Muster:
        """What there is to do, and who is there; any thread may ask."""
        return muster([*self._runs.values()], [*self._leases.seats.values()])

    def part_with(self, names: Collection[str]) -> None:
        """Lease nothing more to these workers, and send each home once it holds nothing."""
        self._departures.name(names)

    def alive(self) -> bool:
        """Whether its thread runs."""
        return self._thread.is_alive()

    def stop(self) -> None:
        """Send the workers home, end the learners, commit what came, and close."""
        self._stopping.set()
        if self._thread.ident is None:  # it was never started
            self._router.close()
        else:
            self._thread.join()

    def _serve(self) -> None:
        try:
            while not self._stopping.is_set():
                self._wait()
                with timed(self.vitals.turn_s):
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
            self._stranded.note(self._runs.keys())
        self._desk.bury_silent()
        self._desk.send_home(self._departures)
        if not (self._away or self._commits.stuck):  # else what comes of it could not be kept
            self._desk.assign(self._runs)
        self._look()

    def _wait(self) -> None:
        learners = [run.socket for run in self._runs.values()]
        self._ears.wait([self._router], learners, TICK_MS)

    def _obey(self) -> None:
        with contextlib.suppress(Empty):
            while True:
                self._commands.get_nowait()()

    def _launch(self, order: Order) -> None:
        run = Run(order, self._store, self._leases, self._learners, self.vitals)
        self._runs[order.campaign] = run
        if order.setup.simulator == bridges.SIMULATOR:
            self._leases.need_bridge(order.campaign)

    def _weigh(self, campaign: int, weight: float) -> None:
        if campaign in self._runs:
            self._leases.weigh(campaign, weight)

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
        if time.monotonic() >= self._next_look_s:
            self.vitals.standing = standing(self._runs, self._leases.seats.values())
            self._next_look_s = time.monotonic() + LOOK_EVERY_S

    def _commit(self, *, now: bool = False) -> None:
        committed = self._commits.flush(now=now or self._is_awaited())
        self._desk.acknowledge(committed)
        for each in committed:
            if run := self._runs.get(each.campaign):
                run.land(each.result, each.verdict)

    def _is_awaited(self) -> bool:
        """Whether the last results of a round wait: none is to come to share their commit."""
        campaigns = set() if self._commits.stuck else self._commits.campaigns()
        return not all(map(self._leases.expects, campaigns))

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
