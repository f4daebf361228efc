"""Connected workers, the episodes that each holds, and the episodes that wait for a worker.

A worker is named by its connection: the identity that the hub's ROUTER gives it.
"""

import time
from collections import OrderedDict
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from typing import NamedTuple

import structlog

from eigenfail.values.episode import EpisodeTask
from eigenfail.values.operations import Arrival
from eigenfail.wire.messages import FINISHED, Hello, Holding
from eigenfail_services.store.events import EventLog
from eigenfail_services.store.roster import Roster

WORK_AHEAD_S = 2.0
"""Seconds of work that a worker should hold, so that it never waits for the hub."""

LONG_EPISODE_S = 0.5
"""Duration from which an episode is leased only to a worker that can start it at once. [s]

The answer of the hub takes a small part of that time. An episode that was leased ahead would wait
for the end of the one before it, however long that takes, while other workers may be idle.
"""


MAX_UNNAMED_HEARTBEATS = 10
"""A worker that omits an episode from this many heartbeats in a row does not hold it."""


SMOOTHING = 0.2


MAX_SLOWNESS = 100.0
"""Bound of the factor by which a worker may be rated slower or faster than the others."""


Key = tuple[int, int]
"""Campaign and index of an episode."""


Fingerprint = Callable[[int, EpisodeTask], bytes]
"""Fingerprint of a campaign's task, as workers send it with the episodes that they hold."""


class EndedLease(NamedTuple):
    """A lease that is over: its task, its estimated work [s] and the session that held it."""

    task: EpisodeTask
    work_s: float
    session: "WorkerSession"


class WorkerSession:
    """A connected worker, with its episodes and the data that it was sent.

    Attributes:
        arrival: its description of itself.
        last_heard_s: time of its last message.
        has_bridge: whether it can run episodes that need a bridge.
        offer: offer of its bridge, as JSON; None until it is known.
        running: the episode that it runs, by its last heartbeat.
        parallel: number of episodes of the running campaign that it can run at the same time.
        held: the episodes that are leased to it and still lack a result.
        load_s: estimated work in `held`. [s]
        slowness: duration of its episodes divided by their usual duration.
        life: random name of its process; empty if it sent none.
        setups: the campaigns whose setup it was sent.
        policies: campaign and version of each policy that it was sent.
    """

    def __init__(self, hello: Hello, now_s: float) -> None:
        self.name = hello.worker
        self.arrival = Arrival(
            worker=hello.worker, host=hello.host, pid=hello.pid, versions=hello.versions
        )
        self.credit = hello.credit
        self.last_heard_s = now_s
        self.has_bridge = hello.bridge
        self.offer: str | None = None
        self.running: Key | None = None
        self.parallel = 1
        self.held: dict[Key, EpisodeTask] = {}
        self.load_s = 0.0
        self.slowness = 1.0
        self.life = hello.life
        self.setups: set[int] = set()
        self.policies: set[tuple[int, int]] = set()
        self._slots: dict[int, int] = {}
        self._asked = hello.asked
        self._unnamed: dict[Key, int] = {}
        self._work_s: dict[Key, float] = {}

    def was_opened_by(self, hello: Hello) -> bool:
        """Return whether this hello opened the session and was repeated before its welcome came."""
        return bool(self.life) and (self.life, self._asked) == (hello.life, hello.asked)

    def set_running(self, running: Key | None, slots: int) -> bool:
        """Note the running episode and its parallel slots; return whether `parallel` changed."""
        before, self.parallel = self.parallel, slots if running else 1
        self.running = running
        if running in self.held:
            self._slots[running[0]] = slots
        return self.parallel != before

    def slots(self, campaign: int) -> int:
        """Return how many episodes of a campaign it runs in parallel, 1 if that is not known."""
        return self._slots.get(campaign, 1)

    def add_lease(self, key: Key, task: EpisodeTask, work_s: float) -> None:
        """Add an episode to the worker's leases."""
        self.held[key] = task
        self.load_s += work_s
        self._work_s[key] = work_s
        self._unnamed.pop(key, None)

    def end_lease(self, key: Key) -> EndedLease:
        """Remove an episode from the worker's leases."""
        work_s = self._work_s.pop(key)
        task = self.held.pop(key)
        # Sums of floats drift; without an episode the load is 0.
        self.load_s = self.load_s - work_s if self.held else 0.0
        return EndedLease(task, work_s, self)

    def update_slowness(self, ratio: float) -> None:
        """Learn from an episode's duration, divided by the usual one."""
        bounded = min(max(ratio, 1.0 / MAX_SLOWNESS), MAX_SLOWNESS)
        self.slowness += SMOOTHING * (bounded - self.slowness)

    def forget_campaign(self, campaign: int) -> None:
        """Forget the policies of a campaign that the worker is about to drop."""
        self.setups.discard(campaign)
        self._slots.pop(campaign, None)
        self.policies = {policy for policy in self.policies if policy[0] != campaign}

    @property
    def room_s(self) -> float:
        """Work to lease to a worker that needs some; its running episode may end any time. [s]"""
        return max(WORK_AHEAD_S - self.load_s, WORK_AHEAD_S / 2)

    def needs_work(self) -> bool:
        """Return whether the worker holds too little work and has credit for more.

        Episodes that run in parallel may all end at the same moment. So a worker should always hold
        more episodes than it runs, unless it runs long ones, one at a time.
        """
        held = len(self.held)
        runs_long = self.parallel == 1 and held > 0 and self.load_s >= LONG_EPISODE_S * held
        is_low = held <= self.parallel or self.load_s <= WORK_AHEAD_S / 2
        return is_low and not runs_long and held <= self.credit // 2 and self.credit > 0

    def find_unnamed(self, expected: Collection[Key], named: Collection[Key]) -> set[Key]:
        """Return the expected episodes that too many heartbeats in a row have not named.

        Args:
            expected: the episodes that the hub believes to be with this worker.
            named: the episodes that its heartbeat names.
        """
        # A heartbeat and a lease may cross on their way once, but not time after time.
        unnamed = set(expected).difference(named)
        self._unnamed = {key: self._unnamed.get(key, 0) + 1 for key in unnamed}
        return {key for key, count in self._unnamed.items() if count >= MAX_UNNAMED_HEARTBEATS}


class WorkerTable:
    """Worker sessions, indexed by connection, process and last message.

    Attributes:
        sessions: the sessions by connection.
    """

    def __init__(self) -> None:
        self.sessions: dict[bytes, WorkerSession] = {}
        self._by_life: dict[str, bytes] = {}
        # Who spoke last is last, which `move_to_end` keeps up to date without sorting.
        self._by_silence: OrderedDict[bytes, None] = OrderedDict()

    def find_connections(self, worker: bytes, hello: Hello) -> list[bytes]:
        """Return the connections on which the sender of a hello has a session already."""
        known = {worker, self._by_life.get(hello.life, worker)}
        return [each for each in known if each in self.sessions]

    def add(self, worker: bytes, hello: Hello, now_s: float) -> None:
        """Open the session of a worker that has none."""
        self.sessions[worker] = WorkerSession(hello, now_s)
        self._by_silence[worker] = None
        if hello.life:
            self._by_life[hello.life] = worker

    def touch(self, worker: bytes, now_s: float) -> WorkerSession | None:
        """Note the time of a worker's message; return its session, if it has one."""
        if session := self.sessions.get(worker):
            session.last_heard_s = now_s
            self._by_silence.move_to_end(worker)
        return session

    def list_silent(self, now_s: float, limit_s: float) -> list[bytes]:
        """Return the workers whose last message is older than the limit."""
        silent = []
        for worker in self._by_silence:  # the longest silence comes first
            if now_s - self.sessions[worker].last_heard_s <= limit_s:
                break
            silent.append(worker)
        return silent

    def excuse_silence(self, duration_s: float, now_s: float) -> None:
        """Do not count time as silence if the hub itself could not read messages."""
        for session in self.sessions.values():
            # All shift alike, so that the order of `_by_silence` stays right.
            session.last_heard_s = min(now_s, session.last_heard_s + duration_s)

    def remove(self, worker: bytes) -> None:
        """Close the session of a worker."""
        session = self.sessions.pop(worker)
        del self._by_silence[worker]
        # Its process may have another connection by now, to which the name belongs.
        if self._by_life.get(session.life) == worker:
            del self._by_life[session.life]


class EpisodeQueue:
    """Episodes that wait for a worker, in order for each campaign, and those that need a result."""

    def __init__(self) -> None:
        # Episodes are appended, put to the front, and removed by index: all in O(1).
        self._queues: dict[int, OrderedDict[int, EpisodeTask]] = {}
        self._needed: dict[int, set[int]] = {}
        self._nonempty: dict[int, None] = {}

    def list_waiting_campaigns(self) -> Collection[int]:
        """Return the campaigns with at least one waiting episode."""
        return self._nonempty.keys()

    def tasks(self, campaign: int) -> OrderedDict[int, EpisodeTask]:
        """Return the waiting episodes of a campaign by index."""
        return self._queues.get(campaign, OrderedDict())

    def has_campaign(self, campaign: int) -> bool:
        """Return whether episodes of a campaign were requested and not called off."""
        return campaign in self._queues

    def needs_result(self, campaign: int, index: int) -> bool:
        """Return whether an episode still needs a result, waiting or leased."""
        return index in self._needed.get(campaign, ())

    def require(self, campaign: int, tasks: Collection[EpisodeTask]) -> None:
        """Note that these episodes need results, without having them wait for a worker."""
        self._needed.setdefault(campaign, set()).update(task.index for task in tasks)
        self._queues.setdefault(campaign, OrderedDict())

    def append(self, campaign: int, task: EpisodeTask) -> None:
        """Put an episode at the end of its campaign's queue."""
        self._queues[campaign][task.index] = task
        self._nonempty[campaign] = None

    def put_back(self, campaign: int, task: EpisodeTask) -> None:
        """Put an episode at the front of its campaign's queue, if it needs a result.

        An episode that needs no result now may be required again later, with the policy of that
        time.
        """
        if self.needs_result(campaign, task.index):
            self.append(campaign, task)
            self._queues[campaign].move_to_end(task.index, last=False)

    def pop(self, campaign: int, index: int | None = None) -> EpisodeTask:
        """Remove and return a campaign's first waiting episode, or the one with the index."""
        queue = self._queues[campaign]
        task = queue.popitem(last=False)[1] if index is None else queue.pop(index)
        if not queue:
            del self._nonempty[campaign]
        return task

    def complete(self, campaign: int, index: int) -> None:
        """Remove an episode that has a result."""
        if campaign not in self._queues:
            return
        self._needed[campaign].discard(index)
        if index in self._queues[campaign]:
            self.pop(campaign, index)

    def remove_campaign(self, campaign: int) -> None:
        """Remove a campaign: none of its episodes needs a result any more."""
        self._queues.pop(campaign, None)
        self._needed.pop(campaign, None)
        self._nonempty.pop(campaign, None)


class MatchedHolding(NamedTuple):
    """A waiting episode that a worker holds from before, and whether it holds the same task."""

    worker: bytes
    key: Key
    is_same_task: bool


class Holdings:
    """Episodes that workers hold from before this hub knew them, with their tasks' fingerprints.

    A holding waits here until its episode is proposed or has a result, or the worker's heartbeats
    do not name it. A worker cannot have more of them than one hello may hold.
    """

    def __init__(self) -> None:
        self._fingerprints: dict[int, dict[int, dict[bytes, bytes]]] = {}
        self._by_worker: dict[bytes, set[Key]] = {}
        self._changed: set[int] = set()

    def add(self, worker: bytes, holdings: Iterable[Holding]) -> None:
        """Add the holdings of a worker's hello to its earlier ones."""
        for holding in holdings:
            episodes = self._fingerprints.setdefault(holding.campaign, {})
            episodes.setdefault(holding.index, {})[worker] = holding.task
            self._by_worker.setdefault(worker, set()).add((holding.campaign, holding.index))
            self.mark_changed(holding.campaign)

    def mark_changed(self, campaign: int) -> None:
        """Note that an episode of a campaign waits that did not wait before."""
        self._changed.add(campaign)

    def match(self, queue: EpisodeQueue, fingerprint: Fingerprint) -> Iterator[MatchedHolding]:
        """Remove and yield the holdings of waiting episodes; of equal ones, the oldest comes first.

        Campaigns without a new holding or waiting episode since the last call are skipped.
        """
        while self._changed:
            campaign = self._changed.pop()
            # A copy, as `discard` changes the tables.
            holdings = [
                (index, worker, held)
                for index, workers in self._fingerprints.get(campaign, {}).items()
                for worker, held in workers.items()
            ]
            for index, worker, held in holdings:
                task = queue.tasks(campaign).get(index)
                if task is not None:
                    self.discard(worker, (campaign, index))
                    is_same_task = held in (FINISHED, fingerprint(campaign, task))
                    yield MatchedHolding(worker, (campaign, index), is_same_task)

    def held_by(self, worker: bytes) -> set[Key]:
        """Return the episodes that a worker holds from before."""
        return set(self._by_worker.get(worker, ()))

    def discard(self, worker: bytes, key: Key) -> None:
        """Remove a worker's holding of an episode."""
        campaign, index = key
        del self._fingerprints[campaign][index][worker]
        self._by_worker[worker].remove(key)
        if not self._fingerprints[campaign][index]:
            del self._fingerprints[campaign][index]
        if not self._fingerprints[campaign]:
            del self._fingerprints[campaign]
        if not self._by_worker[worker]:
            del self._by_worker[worker]

    def remove_worker(self, worker: bytes) -> None:
        """Remove all holdings of a worker."""
        for key in self.held_by(worker):
            self.discard(worker, key)

    def complete(self, key: Key) -> None:
        """Remove all holdings of an episode that has a result."""
        campaign, index = key
        for worker in [*self._fingerprints.get(campaign, {}).get(index, ())]:
            self.discard(worker, key)

    def remove_campaign(self, campaign: int) -> None:
        """Remove all holdings of a campaign."""
        for index in [*self._fingerprints.get(campaign, ())]:
            self.complete((campaign, index))


ROSTER_INTERVAL_S = 1.0


HEARTBEAT_INTERVAL_S = 5.0


GRACE_PERIOD_S = 5.0
"""Time without a suitable worker before an event: workers connect a moment after their services
start, and again after their connections were cut."""


WORKERS_LACKING, WORKERS_MET = "workers.lacking", "workers.met"


NO_BRIDGE = (
    "No connected worker has a bridge: start one with `eigenfail worker --connect ADDRESS "
    "--bridge tcp://HOST:PORT`. Until then the campaign waits."
)


BRIDGE_CONNECTED = "A worker with a bridge is connected, and the campaign goes on."


log = structlog.get_logger()


class RosterWriter:
    """Records arrivals and departures of workers, and regularly that the rest are still connected.

    Args:
        roster: roster to write to.
        sessions: sessions of the connected workers, by connection.
    """

    def __init__(self, roster: Roster, sessions: Mapping[bytes, WorkerSession]) -> None:
        self._roster = roster
        self._sessions = sessions
        self._numbers: dict[WorkerSession, int] = {}
        self._offers: dict[WorkerSession, str | None] = {}
        self._next_update_s = self._next_heartbeat_s = time.monotonic()

    def update(self) -> None:
        """Write the changes since the last update, if an update is due.

        Raises:
            StoreUnavailable: the next call tries again.
        """
        now_s = time.monotonic()
        if now_s < self._next_update_s:
            return
        # Arrivals first: offers and departures are written to the rows that arrivals made.
        arrived = [each for each in self._sessions.values() if each not in self._numbers]
        if arrived:
            numbers = self._roster.arrived([session.arrival for session in arrived])
            self._numbers.update(zip(arrived, numbers, strict=True))
        self._write_offers()
        left = self._numbers.keys() - {*self._sessions.values()}
        if left:
            self._roster.left([self._numbers[session] for session in left])
            for session in left:
                del self._numbers[session]
                self._offers.pop(session, None)
        if now_s >= self._next_heartbeat_s and self._numbers:
            self._roster.heard(self._numbers.values())
            self._next_heartbeat_s = now_s + HEARTBEAT_INTERVAL_S
        # Last, so that the next turn tries again if the store is away.
        self._next_update_s = now_s + ROSTER_INTERVAL_S

    def _write_offers(self) -> None:
        changed = {
            session: session.offer
            for session in self._sessions.values()
            if session.offer != self._offers.get(session)
        }
        if changed:
            self._roster.set_offers({self._numbers[each]: offer for each, offer in changed.items()})
            self._offers |= changed

    def close(self) -> None:
        """Write that all workers have left.

        Raises:
            StoreUnavailable: it could not be written.
        """
        if self._numbers:
            self._roster.left(self._numbers.values())
        self._numbers.clear()


class UnrunnableCampaigns:
    """Writes an event for a campaign that no connected worker can run, and when one can again.

    Args:
        events: log to write to.
        list_unrunnable: returns the campaigns with waiting episodes that no worker can run.
        has_bridge: returns whether a worker with a bridge is connected. Without waiting episodes, a
            campaign needs no worker, so only this shows that one has come.
    """

    def __init__(
        self,
        events: EventLog,
        list_unrunnable: Callable[[], Collection[int]],
        has_bridge: Callable[[], bool],
    ) -> None:
        self._events = events
        self._list_unrunnable = list_unrunnable
        self._has_bridge = has_bridge
        self._since_s: dict[int, float] = {}
        self._reported: set[int] = set()

    def update(self, running: Collection[int]) -> None:
        """Write the events that are due.

        Args:
            running: running campaigns; no event is written for other campaigns.

        Raises:
            StoreUnavailable: the next call tries again.
        """
        now_s, unrunnable = time.monotonic(), self._list_unrunnable()
        self._since_s = {each: self._since_s.get(each, now_s) for each in unrunnable}
        self._reported &= {*running}
        for campaign, since_s in self._since_s.items():
            if campaign not in self._reported and now_s - since_s >= GRACE_PERIOD_S:
                self._write(WORKERS_LACKING, NO_BRIDGE, campaign)
                self._reported.add(campaign)
        for campaign in self._reported.difference(unrunnable) if self._has_bridge() else ():
            self._write(WORKERS_MET, BRIDGE_CONNECTED, campaign)
            self._reported.remove(campaign)

    def _write(self, kind: str, message: str, campaign: int) -> None:
        self._events.append(kind, message, campaign)
        log.warning(message, kind=kind, campaign=campaign)
