"""Leases of episodes to workers: a state machine without a socket. Events in, assignments out."""

from collections import defaultdict
from collections.abc import Collection, Iterator
from typing import NamedTuple

from eigenfail.values.episode import EpisodeTask
from eigenfail.wire.messages import Hello, is_same_task
from eigenfail_services.hub import worker_table
from eigenfail_services.hub.scheduler import Assignment, Scheduler


class LeaseTable:
    """The episodes that each worker holds; each change is O(log n).

    Args:
        sessions: sessions of the connected workers, which are kept up to date.
        scheduler: notified of each change.
    """

    def __init__(
        self, sessions: dict[bytes, worker_table.WorkerSession], scheduler: Scheduler
    ) -> None:
        self._sessions = sessions
        self._scheduler = scheduler
        self._holders: defaultdict[int, dict[int, bytes]] = defaultdict(dict)

    def has_leases(self, campaign: int) -> bool:
        """Return whether a worker holds any episode of a campaign."""
        # Not by index, which would add the campaign to a `defaultdict`.
        return bool(self._holders.get(campaign))

    def find_task(self, key: worker_table.Key) -> EpisodeTask | None:
        """Return the leased task of an episode, if a worker holds it."""
        worker = self._holders.get(key[0], {}).get(key[1])
        return None if worker is None else self._sessions[worker].held[key]

    def lease(self, worker: bytes, key: worker_table.Key, task: EpisodeTask) -> None:
        """Lease an episode to a worker, and charge its campaign for the estimated work."""
        session = self._sessions[worker]
        work_s = self._scheduler.estimate_work_s(key[0], session)
        session.add_lease(key, task, work_s)
        self._holders[key[0]][key[1]] = worker
        self._scheduler.charge(key[0], session, work_s)
        self._scheduler.update_worker(worker, session)

    def end(self, key: worker_table.Key) -> worker_table.EndedLease:
        """End a lease; its campaign stays charged for the estimated work."""
        worker = self._holders[key[0]].pop(key[1])
        session = self._sessions[worker]
        ended = session.end_lease(key)
        self._scheduler.update_worker(worker, session)
        return ended

    def complete(self, key: worker_table.Key, by: bytes | None) -> worker_table.EndedLease | None:
        """End the lease of an episode that has a result.

        Args:
            key: key of the episode.
            by: the worker that brought the result; None for whichever holds the episode.

        Returns:
            The lease under which the result was made; None if that worker holds none any more. A
            lease of another worker is revoked.
        """
        holder = self._holders.get(key[0], {}).get(key[1])
        if holder is None:
            return None
        if by in (None, holder):
            return self.end(key)
        self.revoke(key)
        return None

    def revoke(self, key: worker_table.Key) -> EpisodeTask:
        """End a lease whose episode was not run, and refund its campaign."""
        ended = self.end(key)
        self._scheduler.charge(key[0], ended.session, -ended.work_s)
        return ended.task

    def end_all(self, campaign: int) -> None:
        """End all leases of a campaign."""
        for index in [*self._holders.get(campaign, ())]:
            self.end((campaign, index))
        self._holders.pop(campaign, None)


class Disconnection(NamedTuple):
    """The episode that a worker ran as its connection closed, and the end of its time to return."""

    key: worker_table.Key
    task: EpisodeTask
    until_s: float


class InterruptedEpisodes:
    """Episodes that were running when their workers were lost or disconnected.

    Episodes of lost workers wait until the death is counted. A disconnected worker may have lost
    only its connection, so it has time to come back.
    """

    def __init__(self) -> None:
        self._lost: dict[worker_table.Key, EpisodeTask] = {}
        self._disconnections: dict[str, Disconnection] = {}
        # By episode, then by worker: several may have run it, one after the other.
        self._running: dict[worker_table.Key, dict[str, EpisodeTask]] = {}

    def __iter__(self) -> Iterator[tuple[int, EpisodeTask]]:
        """Iterate over campaigns and episodes whose deaths are to be counted."""
        return ((campaign, task) for (campaign, _), task in self._lost.items())

    def add(self, key: worker_table.Key, task: EpisodeTask) -> None:
        """Add an episode whose worker is lost for good."""
        self._lost[key] = task

    def pop(self, key: worker_table.Key) -> EpisodeTask | None:
        """Remove and return an episode whose death is counted or that has a result."""
        return self._lost.pop(key, None)

    def remove_campaign(self, campaign: int) -> None:
        """Remove the episodes of a campaign that is over."""
        self._lost = {key: task for key, task in self._lost.items() if key[0] != campaign}

    def withholds(self, key: worker_table.Key, task: EpisodeTask) -> bool:
        """Return whether an episode must not be leased now.

        Either its death is to be counted, or two disconnected workers ran it. One worker may have
        lost only its connection. A second disconnection is hardly chance, and a third worker would
        be lost before the first death is counted.
        """
        same = [other for other in self._running.get(key, {}).values() if is_same_task(other, task)]
        return key in self._lost or len(same) > 1

    def disconnect(self, worker: str, disconnection: Disconnection) -> None:
        """Note that the connection of a worker closed while it ran an episode."""
        self.pop_disconnection(worker)
        self._disconnections[worker] = disconnection
        self._running.setdefault(disconnection.key, {})[worker] = disconnection.task

    def pop_disconnection(self, worker: str) -> Disconnection | None:
        """Remove and return the disconnection of a worker that is alive, if it has one."""
        if disconnection := self._disconnections.pop(worker, None):
            del self._running[disconnection.key][worker]
            if not self._running[disconnection.key]:
                del self._running[disconnection.key]
        return disconnection

    def extend(self, duration_s: float) -> None:
        """Give disconnected workers more time: the hub could not hear them for a while."""
        self._disconnections = {
            worker: each._replace(until_s=each.until_s + duration_s)
            for worker, each in self._disconnections.items()
        }

    def pop_overdue(self, now_s: float) -> list[Disconnection]:
        """Remove and return the disconnections of workers that did not come back in time.

        If several workers ran the same episode, one of them at a time: each death is counted.
        """
        overdue = {
            each.key: worker
            for worker, each in self._disconnections.items()
            if now_s >= each.until_s and each.key not in self._lost
        }
        return [each for worker in overdue.values() if (each := self.pop_disconnection(worker))]


class Leases:
    """Leases episodes to workers in batches, and takes them back from workers that are gone.

    The effects of some methods on the episodes:

    ==========================  ===================================================================
    `end_session`               The worker is alive: its episodes wait again.
    `end_lost_session`          The worker is lost: its running episode is interrupted.
                                The rest waits again.
    `end_disconnected_session`  The worker's episodes wait again. The running one is interrupted if
                                the worker does not come back in time (`expire_disconnected`).
    `stop_leasing`              The worker finishes its episodes and gets nothing more.
    `unqueue_campaign`          The learner is lost: nothing waits, leases go on.
    `remove_campaign`           The campaign is over: nothing waits, all leases end.
    `record_result`             The episode has a result, which is not committed yet.
    `record_verdict`            The result was judged. If refused, its episode may be offered again.
    `complete`                  The episode has a result: it does not wait, and its lease ends.
    ==========================  ===================================================================

    Attributes:
        sessions: sessions of the connected workers, by connection.
    """

    def __init__(self) -> None:
        self._workers = worker_table.WorkerTable()
        self.sessions = self._workers.sessions
        self._scheduler = Scheduler()
        self._table = LeaseTable(self.sessions, self._scheduler)
        self._queue = worker_table.EpisodeQueue()
        self._holdings = worker_table.Holdings()
        self._interrupted = InterruptedEpisodes()
        # Episodes whose results wait for their commit: to run them again would be a waste.
        self._uncommitted: set[worker_table.Key] = set()

    def open_session(self, worker: bytes, hello: Hello, now_s: float) -> None:
        """Open the session of a worker, with the episodes that it holds from before.

        An earlier session of the worker, by this connection or another one, ends: episodes that the
        worker held and does not name can be leased again.
        """
        for old in self._workers.find_connections(worker, hello):
            self.end_session(old)
        # What it ran waits again: if its hello names that episode, the episode stays with this
        # worker (`lease_held_episodes`).
        if disconnection := self._interrupted.pop_disconnection(hello.life):
            self._put_back(disconnection.key[0], disconnection.task)
        self._workers.add(worker, hello, now_s)
        self._holdings.add(worker, hello.holdings)
        self._scheduler.update_worker(worker, self.sessions[worker])

    def touch(self, worker: bytes, now_s: float) -> worker_table.WorkerSession | None:
        """Note the time of a worker's message; return its session, if it has one."""
        return self._workers.touch(worker, now_s)

    def record_heartbeat(
        self,
        worker: bytes,
        running: worker_table.Key | None,
        named: Collection[worker_table.Key],
        slots: int = 1,
    ) -> None:
        """Process a worker's heartbeat, and free episodes that it has not named for long.

        A lease or a result of such an episode was lost on its way.

        Args:
            worker: worker that sent it.
            running: the episode that it runs, if any: the one to suspect if the worker is lost.
            named: all episodes that it holds.
            slots: number of episodes of the running campaign that it can run in parallel.
        """
        session = self.sessions[worker]
        if session.set_running(running, slots):
            self._scheduler.update_worker(worker, session)
        from_before = self._holdings.held_by(worker)
        unnamed = session.find_unnamed(session.held.keys() | from_before, named)
        for key in unnamed & from_before:
            self._holdings.discard(worker, key)
        self._free(session, unnamed)

    def has_leases(self, campaign: int) -> bool:
        """Return whether a worker holds any episode of a campaign."""
        return self._table.has_leases(campaign)

    def expects_results(self, campaign: int) -> bool:
        """Return whether any episode of a campaign is leased or waits."""
        return self.has_leases(campaign) or campaign in self._queue.list_waiting_campaigns()

    def needs_result(self, campaign: int, index: int) -> bool:
        """Return whether an episode was offered and still lacks a result."""
        return self._queue.needs_result(campaign, index)

    def episode_s(self, campaign: int) -> float:
        """Return the estimated duration of an episode of a campaign. [s]"""
        return self._scheduler.episode_s(campaign)

    def stop_leasing(self, worker: bytes) -> None:
        """Lease nothing more to a worker."""
        session = self.sessions[worker]
        session.credit = 0
        self._scheduler.update_worker(worker, session)

    def list_silent(self, now_s: float, limit_s: float) -> list[bytes]:
        """Return the workers whose last message is older than the limit."""
        return self._workers.list_silent(now_s, limit_s)

    def excuse_silence(self, duration_s: float, now_s: float) -> None:
        """Do not count time as silence if the hub itself could not read messages."""
        self._workers.excuse_silence(duration_s, now_s)
        self._interrupted.extend(duration_s)

    def end_session(self, worker: bytes) -> None:
        """End the session of a live worker; its episodes wait again, at the front."""
        self._holdings.remove_worker(worker)
        if session := self.sessions.get(worker):
            self._free(session, set(session.held))
            self._workers.remove(worker)
            self._scheduler.remove_worker(worker, session)

    def end_lost_session(self, worker: bytes) -> None:
        """End a lost worker's session: its running episode is suspected, the rest waits again."""
        session = self.sessions[worker]
        # First, as `end_session` has all the rest wait again at once.
        if session.running is not None and session.running in session.held:
            self._interrupted.add(session.running, self._table.end(session.running).task)
        self.end_session(worker)

    def end_disconnected_session(self, worker: bytes, until_s: float) -> None:
        """End the session of a disconnected worker: its leases return to the queue.

        The worker's running episode is suspected if the worker does not come back by `until_s`.
        """
        session = self.sessions[worker]
        running = session.running
        if running is not None and (task := session.held.get(running)) is not None:
            name = session.life or worker.hex()
            self._interrupted.disconnect(name, Disconnection(running, task, until_s))
        self.end_session(worker)

    def expire_disconnected(self, now_s: float) -> None:
        """Suspect the running episode of each disconnected worker that did not return in time."""
        for key, task, _ in self._interrupted.pop_overdue(now_s):
            if self._queue.needs_result(*key):
                self._interrupted.add(key, task)

    def list_interrupted(self) -> list[tuple[int, EpisodeTask]]:
        """Return the interrupted episodes of lost workers, before their deaths are counted."""
        # A copy, as episodes are cleared while the caller goes through them.
        return [*self._interrupted]

    def clear_interrupted(self, campaign: int, index: int) -> None:
        """Have an interrupted episode wait again, at the front, unless a worker holds it."""
        if task := self._interrupted.pop((campaign, index)):
            self._put_back(campaign, task)

    def _free(
        self, session: worker_table.WorkerSession, keys: Collection[worker_table.Key]
    ) -> None:
        # Each goes to the front of its queue, so that the first one leased has to be put there
        # last.
        for key in reversed([key for key in session.held if key in keys]):
            self._put_back(key[0], self._table.revoke(key))

    def _put_back(self, campaign: int, task: EpisodeTask) -> None:
        key = campaign, task.index
        # Several workers may have held it, one after the other, and each of them puts it back.
        is_free = self._table.find_task(key) is None and not self._interrupted.withholds(key, task)
        if is_free and task.index not in self._queue.tasks(campaign):
            self._queue.put_back(campaign, task)
            self._holdings.mark_changed(campaign)

    def offer(self, campaign: int, tasks: tuple[EpisodeTask, ...]) -> None:
        """Have these episodes run, except those that a worker runs or has just brought."""
        self._queue.require(campaign, tasks)
        self._holdings.mark_changed(campaign)
        for task in tasks:
            if not self._is_taken(campaign, task):
                self._queue.append(campaign, task)

    def _is_taken(self, campaign: int, task: EpisodeTask) -> bool:
        key = campaign, task.index
        if key in self._uncommitted or self._interrupted.withholds(key, task):
            return True
        leased = self._table.find_task(key)
        if leased is None or is_same_task(leased, task):
            return leased is not None
        # The worker runs another task under this index, say of an older policy. Its time stays
        # charged.
        self._table.end(key)
        return False

    def set_weight(self, campaign: int, weight: float) -> None:
        """Set the weight of a campaign's share of worker time."""
        self._scheduler.set_weight(campaign, weight)

    def require_bridge(self, campaign: int) -> None:
        """Lease the episodes of a campaign only to workers with a bridge."""
        self._scheduler.require_bridge(campaign)

    def list_unrunnable(self) -> Collection[int]:
        """Return the campaigns with waiting episodes that no connected worker can run."""
        return self._scheduler.list_unrunnable(self._queue.list_waiting_campaigns())

    def has_bridge(self) -> bool:
        """Return whether a worker with a bridge is connected."""
        return self._scheduler.has_bridge()

    def unqueue_campaign(self, campaign: int) -> None:
        """Lease nothing more of a campaign whose learner is lost; leases stay with their workers.

        The next learner proposes the same episodes again: it starts from a checkpoint that was
        committed before any of them was leased. The checkpoint holds the open rounds with their
        indices, seeds and policy versions.
        """
        self._queue.remove_campaign(campaign)

    def remove_campaign(self, campaign: int) -> None:
        """End everything about a campaign: none of its episodes is to be run any more."""
        self._queue.remove_campaign(campaign)
        self._holdings.remove_campaign(campaign)
        self._interrupted.remove_campaign(campaign)
        self._table.end_all(campaign)
        self._scheduler.remove_campaign(campaign)

    def record_result(
        self, campaign: int, index: int, wall_s: float, by: bytes | None = None
    ) -> None:
        """Settle an episode whose result came, and note that the result waits for its commit."""
        self._uncommitted.add((campaign, index))
        self.complete(campaign, index, wall_s, by)

    def record_verdict(self, campaign: int, index: int) -> None:
        """Note that a received result was judged; if refused, its episode may be offered again."""
        self._uncommitted.discard((campaign, index))

    def complete(self, campaign: int, index: int, wall_s: float, by: bytes | None = None) -> None:
        """End everything about an episode that has a result.

        Args:
            campaign: campaign of the episode.
            index: index of the episode.
            wall_s: duration that its result reports. [s]
            by: the worker that brought the result; None for whichever holds the episode.
        """
        key = campaign, index
        self._holdings.complete(key)
        self._interrupted.pop(key)
        self._queue.complete(campaign, index)
        lease = self._table.complete(key, by)
        # A late result of a campaign that is over would bring back its clock and its estimates.
        if self._queue.has_campaign(campaign):
            self._scheduler.record_duration(campaign, wall_s, lease)

    def lease_held_episodes(self, fingerprint: worker_table.Fingerprint) -> set[tuple[bytes, int]]:
        """Lease each waiting episode that a worker holds from before to that worker.

        After a restart of the hub, a campaign goes on from a checkpoint that was committed before
        the first lease of its rounds. So a task that a worker took before is the task that waits
        here. If it is not, as with a worker of another service, the fingerprints differ.

        Returns:
            Pairs of a worker and a campaign whose held task differs from the waiting task.
        """
        refused = set()
        for holding in self._holdings.match(self._queue, fingerprint):
            if holding.is_same_task:
                self._table.lease(holding.worker, holding.key, self._queue.pop(*holding.key))
            else:
                refused.add((holding.worker, holding.key[0]))
        return refused

    def assign(self) -> list[Assignment]:
        """Lease waiting episodes, least loaded workers first, until no worker needs more."""
        assignments = []
        while (assignment := self._scheduler.assign_next(self.sessions, self._queue)) is not None:
            for task in assignment.tasks:
                self._table.lease(assignment.worker, (assignment.campaign, task.index), task)
            assignments.append(assignment)
        return assignments
