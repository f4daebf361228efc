"""The hub: one ROUTER socket for all workers, served by its own thread."""

import contextlib
import time
from collections.abc import Callable, Collection, Iterator
from functools import partial
from itertools import groupby
from operator import attrgetter
from queue import Empty, SimpleQueue
from threading import Event, Thread

import msgspec
import structlog
import zmq

from eigenfail.errors import ClaimLost, StoreUnavailable
from eigenfail.worlds import world_of
from eigenfail_services.bounds import NO_BOUNDS, SettingBounds
from eigenfail_services.hub import metrics
from eigenfail_services.hub.commits import CodeRecorder, CommitQueue, WorkerDeaths
from eigenfail_services.hub.keys import HubKeys
from eigenfail_services.hub.leases import Leases
from eigenfail_services.hub.runs import CampaignRun, RunSpec
from eigenfail_services.hub.transport import Poller, bind, is_connected, send
from eigenfail_services.hub.worker_sessions import Draining, WorkerSessions
from eigenfail_services.hub.worker_table import RosterWriter, UnrunnableCampaigns
from eigenfail_services.store.store import Store

# Commands come through a queue, which wakes no poller: they wait up to this long.
TICK_MS = 20
MESSAGES_PER_TURN = 2_000
"""Messages that are handled before the rest of a turn. A result of usual size comes in two pieces,
so these are as many results as one commit takes."""

FAREWELL_S = 3.0
"""Time that a stopping hub gives its workers to hand over finished results."""

STATUS_INTERVAL_S = 1.0
"""Age that the published status may reach."""

WARNING_INTERVAL_S = 1.0

log = structlog.get_logger()


class FinishedRun(msgspec.Struct, frozen=True):
    """A campaign that the hub does not run any more.

    Attributes:
        campaign: id of the campaign.
        problem: why it failed; empty if it came to its end or was halted.
        stopped_because: why it came to its end; empty if it was halted.
        lost: whether it belongs to another process now.
        declined: why a worker cannot run any of its episodes; empty if none declined.
    """

    campaign: int
    problem: str
    stopped_because: str = ""
    lost: bool = False
    declined: str = ""


class Hub:
    """Runs campaigns on the connected workers.

    Commands come in and finished runs go out through queues; everything else happens in its thread.
    With keys, only workers with accepted keys can reach it.

    Attributes:
        address: address that it listens on.
        finished_runs: campaigns that it does not run any more.
        metrics: metrics for Prometheus.

    Raises:
        PortTaken: another process listens on the address.
    """

    def __init__(
        self,
        store: Store,
        address: str,
        keys: HubKeys | None = None,
        learners: SettingBounds = NO_BOUNDS,
    ) -> None:
        self._router = bind(address, keys)
        self.address: str = self._router.getsockopt_string(zmq.LAST_ENDPOINT)
        self.finished_runs: SimpleQueue[FinishedRun] = SimpleQueue()
        self._store = store
        self._learners = learners
        self._leases = Leases()
        self.metrics = metrics.Metrics()
        self._commits = CommitQueue(store.episodes, self.metrics, self._receive)
        self._code = CodeRecorder(store.campaigns)
        self._sessions = WorkerSessions(
            partial(send, self._router),
            self._leases,
            self._commits,
            self.metrics,
            partial(is_connected, self._router),
        )
        self._deaths = WorkerDeaths(self._leases, self._commits, store.episodes)
        self._roster = RosterWriter(store.roster, self._leases.sessions)
        self._unrunnable = UnrunnableCampaigns(
            store.events, self._leases.list_unrunnable, self._leases.has_bridge
        )
        self._draining = Draining()
        self._runs: dict[int, CampaignRun] = {}
        self._is_store_away = False
        self._poller = Poller()
        self._next_status_s = self._next_warning_s = 0.0
        self._commands: SimpleQueue[Callable[[], None]] = SimpleQueue()
        self._stopping = Event()
        self._thread = Thread(target=self._serve, name="hub")

    def start(self) -> None:
        """Start the hub's thread."""
        self._thread.start()

    def launch(self, spec: RunSpec) -> None:
        """Run a campaign, until it is among the finished runs."""
        self._commands.put(lambda: self._launch(spec))

    def set_weight(self, campaign: int, weight: float) -> None:
        """Set the weight of a campaign's share of worker time, if it runs."""
        self._commands.put(lambda: self._set_weight(campaign, weight))

    def halt(self, campaign: int) -> None:
        """Stop running a campaign, which then is among the finished runs."""
        self._commands.put(lambda: self._halt(FinishedRun(campaign, "")))

    def workers(self) -> list[str]:
        """Return the names of the connected workers."""
        # A copy, as the hub's thread may change the table meanwhile.
        return [session.name for session in list(self._leases.sessions.values())]

    def measure_demand(self) -> metrics.WorkerDemand:
        """Return the work and the workers at this moment; any thread may call this."""
        return metrics.measure_demand([*self._runs.values()], [*self._leases.sessions.values()])

    def drain_workers(self, names: Collection[str]) -> None:
        """Lease nothing more to these workers, and dismiss each once it holds no episode."""
        self._draining.set_names(names)

    def is_alive(self) -> bool:
        """Return whether the hub's thread runs."""
        return self._thread.is_alive()

    def stop(self) -> None:
        """Dismiss the workers, end the learners, commit what came, and close."""
        self._stopping.set()
        if self._thread.ident is None:  # it was never started
            self._router.close()
        else:
            self._thread.join()

    def _serve(self) -> None:
        try:
            while not self._stopping.is_set():
                learners = [run.socket for run in self._runs.values()]
                self._poller.wait([self._router], learners, TICK_MS)
                with metrics.observe_duration(self.metrics.turn_s):
                    self.turn()
        finally:
            self._sessions.dismiss_all()
            self._await_results()
            self._close()

    def turn(self) -> None:
        """Do everything that is due, without waiting. Only the hub's own thread may call this."""
        with contextlib.suppress(Empty):
            while True:
                self._commands.get_nowait()()
        self._receive()
        self._halt_declined()
        # After the messages, which show that a worker lives although the hub read them late.
        self._sessions.expire_silent()
        self._sessions.drain(self._draining)
        with self._tolerate_store_failure():
            # Before the leases, so that workers get the episodes of a new round in this turn.
            self._poll_runs()
            # Workers run what is leased while the store is busy with what they have brought.
            self._assign()
            self._commit()
            self._deaths.record()
            self._record_code()
            self._roster.update()
            self._unrunnable.update(self._runs.keys())
        self._update_status()

    def _assign(self) -> None:
        # While the store is unavailable, new leases would bring results that could not be stored.
        if not (self._is_store_away or self._commits.stuck):
            self._sessions.assign(self._runs)

    def _launch(self, spec: RunSpec) -> None:
        run = CampaignRun(spec, self._store, self._leases, self._learners, self.metrics)
        self._runs[spec.campaign] = run
        if world_of(spec.setup.simulator).needs_bridge:
            self._leases.require_bridge(spec.campaign)

    def _set_weight(self, campaign: int, weight: float) -> None:
        if campaign in self._runs:
            self._leases.set_weight(campaign, weight)

    def _halt(self, finished: FinishedRun) -> None:
        if run := self._runs.pop(finished.campaign, None):
            run.stop()
            self._sessions.drop_campaign(finished.campaign)
            self._code.forget(finished.campaign)
            self.finished_runs.put(finished)

    def _receive(self) -> None:
        for _ in range(MESSAGES_PER_TURN):
            try:
                worker, data = self._router.receive()
            except zmq.Again:
                return
            self._sessions.handle(worker, data)

    def _record_code(self) -> None:
        while self._sessions.prepared:
            self._code.note(*self._sessions.prepared.pop())
        self._code.write()

    def _halt_declined(self) -> None:
        """Halt campaigns that a worker cannot run, before all their episodes err alike."""
        while self._sessions.declined:
            campaign, reason = self._sessions.declined.popitem()
            self._halt(FinishedRun(campaign, "", declined=reason))

    def _poll_runs(self) -> None:
        for run in list(self._runs.values()):
            try:
                run.poll()
            except ClaimLost as error:
                log.warning("campaign lost", campaign=run.spec.campaign, problem=str(error))
                self._halt(FinishedRun(run.spec.campaign, "", lost=True))
            if run.end is not None:
                self._halt(FinishedRun(run.spec.campaign, *run.end))

    def _update_status(self) -> None:
        # At the end of a turn, as nothing changes from here until the end of the next one.
        for run in self._runs.values():
            run.update_phase()
        if time.monotonic() >= self._next_status_s:
            self.metrics.status = metrics.summarize_status(
                self._runs, self._leases.sessions.values()
            )
            self._next_status_s = time.monotonic() + STATUS_INTERVAL_S

    def _commit(self, *, now: bool = False) -> None:
        judged = self._commits.flush(now=now or self._has_last_results())
        self._sessions.acknowledge(judged)
        # `flush` returns the results of a campaign next to each other, as `groupby` needs them.
        for campaign, of_campaign in groupby(judged, attrgetter("campaign")):
            if run := self._runs.get(campaign):
                run.take_verdicts(of_campaign)

    def _has_last_results(self) -> bool:
        """Return whether the last results of a round wait, with no others to share their commit."""
        # A store that could not take them is tried once a second, not at every turn.
        campaigns = set() if self._commits.stuck else self._commits.campaigns()
        return not all(map(self._leases.expects_results, campaigns))

    @contextlib.contextmanager
    def _tolerate_store_failure(self) -> Iterator[None]:
        """While the store is unavailable nothing is lost: results wait, and so do their workers."""
        try:
            yield
            self._is_store_away = False
        except StoreUnavailable as error:
            now_s = time.monotonic()
            # The first failure is logged, then one a second: every turn tries again.
            if not self._is_store_away or now_s >= self._next_warning_s:
                self._next_warning_s = now_s + WARNING_INTERVAL_S
                log.warning("store unavailable", problem=str(error))
            self._is_store_away = True
            # Messages of learners that were not read keep their sockets readable: no poll would
            # wait.
            time.sleep(TICK_MS / 1_000)

    def _await_results(self) -> None:
        """Take the results of dismissed workers; unfinished episodes are leased again later."""
        until_s = time.monotonic() + FAREWELL_S
        while True:
            self._receive()
            with self._tolerate_store_failure():
                self._commit(now=True)
            is_any_held = any(session.held for session in self._leases.sessions.values())
            if time.monotonic() >= until_s or not is_any_held:
                return
            self._router.poll(TICK_MS)

    def _close(self) -> None:
        self._receive()
        with self._tolerate_store_failure():
            self._commit(now=True)
            self._roster.close()
        for run in self._runs.values():
            run.stop()
        self._router.close()
