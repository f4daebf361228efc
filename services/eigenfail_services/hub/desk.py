"""The hub's side of the talk with workers: who is in, what each was told, what each brings."""

import time
from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping
from typing import Any

import structlog

from eigenfail.errors import ProtocolError
from eigenfail.values import EpisodeTask, PolicySource
from eigenfail.wire.claims import fingerprint
from eigenfail.wire.messages import (
    Ack,
    Drop,
    Goodbye,
    Heartbeat,
    Hello,
    Lease,
    Message,
    PolicyUpdate,
    Refusal,
    Results,
    Setup,
    Welcome,
    read_worker_message,
)
from eigenfail_services.hub.commits import Commits, Committed
from eigenfail_services.hub.dealer import Assignment
from eigenfail_services.hub.deaths import HUB
from eigenfail_services.hub.departures import Departures
from eigenfail_services.hub.door import Refusals
from eigenfail_services.hub.leases import Leases
from eigenfail_services.hub.lines import QUIET_BEATS, Lines, Reaches, everybody
from eigenfail_services.hub.post import HEARD
from eigenfail_services.hub.runs import Run
from eigenfail_services.hub.skew import foreign_reason, tell_difference, why_not
from eigenfail_services.hub.vitals import Vitals

HEARTBEAT_S = 1.0
SILENCE_LIMIT_S = 10.0

GREETING_S = 3.0
"""What a hub that has just begun waits for hellos: a heartbeat is refused first, and then a
hello comes. Until then others may hold what a campaign that goes on has open."""

log = structlog.get_logger()

Send = Callable[[bytes, Message], None]


class Desk:
    """Answers workers. Messages leave through `send`; results go to `commits`.

    Whose connection is closed is told by `reaches`.
    """

    def __init__(
        self,
        send: Send,
        leases: Leases,
        commits: Commits,
        vitals: Vitals | None = None,
        reaches: Reaches = everybody,
    ) -> None:
        self._send = send
        self._lines = Lines(reaches)
        self._vitals = vitals or Vitals()
        self._leases = leases
        self._commits = commits
        self._refusals = Refusals()
        self._began_s = self._looked_s = time.monotonic()
        self._handlers: dict[type, Callable[[bytes, Any], None]] = {
            Hello: self._hello,
            Heartbeat: self._heartbeat,
            Results: self._results,
            Goodbye: self._goodbye,
        }

    def hear(self, worker: bytes, data: bytes) -> None:
        """Take a worker's bytes, whatever they are."""
        try:
            message = read_worker_message(data)
        except ProtocolError as error:
            if reason := foreign_reason(data):
                self._refuse(worker, reason)
            else:
                self._send(worker, Refusal(str(error)))
            return
        if not isinstance(message, Hello) and not self._leases.heard(worker, time.monotonic()):
            self._send(worker, Refusal("The hub does not know this connection: say hello."))
        else:
            self._handlers[type(message)](worker, message)

    def _hello(self, worker: bytes, message: Hello) -> None:
        if reason := why_not(message.protocol, message.versions):
            self._refuse(worker, reason, named=message.worker, host=message.host)
            return
        seat = self._leases.heard(worker, time.monotonic())
        if seat is None or not seat.was_taken_by(message):
            log.info("worker joined", worker=message.worker, host=message.host, pid=message.pid)
            tell_difference(message.worker, message.versions)
            self._leases.join(worker, message, time.monotonic())
        self._send(worker, Welcome(HEARTBEAT_S))

    def _refuse(self, worker: bytes, reason: str, **facts: str) -> None:
        """One of another release asks again and again: the log has one line for the many."""
        self._refusals.note("it is of another release", why=reason, **facts)
        self._send(worker, Refusal(reason))

    def _heartbeat(self, worker: bytes, message: Heartbeat) -> None:
        running = None
        if message.campaign is not None and message.running is not None:
            running = (message.campaign, message.running)
        self._leases.beat(worker, running, set(message.held), message.slots)
        self._send(worker, HEARD)

    def _results(self, worker: bytes, message: Results) -> None:
        name = self._leases.seats[worker].name
        for result in message.results:
            self._leases.bring(message.campaign, result.index, result.wall_s, worker)
            self._commits.add(worker, name, message.campaign, result)

    def _goodbye(self, worker: bytes, _message: Goodbye) -> None:
        self._leases.leave(worker)

    def bury_silent(self) -> None:
        """Give up who was not heard for long, or for less if its connection is closed.

        A late result is still welcome.
        """
        now_s, before_s = time.monotonic(), self._looked_s
        self._looked_s = now_s
        if now_s - before_s > SILENCE_LIMIT_S / 2:  # the hub was held up, by its store or its host
            self._leases.excuse(now_s - before_s, now_s)
        for worker in self._leases.silent(now_s, SILENCE_LIMIT_S):
            self._give_up(worker, why="it is silent")
            self._leases.lose(worker)
        quiet = self._leases.silent(now_s, QUIET_BEATS * HEARTBEAT_S)
        for worker in self._lines.closed(quiet, now_s):
            self._give_up(worker, why="its connection is closed")
            self._leases.miss(worker, self._leases.seats[worker].heard_s + SILENCE_LIMIT_S)
        self._leases.suspect(now_s)

    def _give_up(self, worker: bytes, why: str) -> None:
        seat = self._leases.seats[worker]
        log.warning("worker lost", worker=seat.name, held=len(seat.held), why=why)
        self._vitals.workers_lost.inc()
        self._vitals.leases_expired.inc(len(seat.held))

    def send_home(self, departures: Departures) -> None:
        """Lease nothing more to those who are to leave, and let go who holds nothing."""
        seats = self._leases.seats
        leaving = departures.leaving(seats)
        for worker in leaving:
            self._leases.retire(worker)
        for worker in departures.ready(leaving, seats, time.monotonic()):
            log.info("worker not needed any more", worker=seats[worker].name)
            self._send(worker, Goodbye("It is not needed any more."))

    def acknowledge(self, committed: Iterable[Committed]) -> None:
        """Tell workers which of their results are safe: each of them once for a campaign."""
        indices: defaultdict[tuple[bytes, int], list[int]] = defaultdict(list)
        for each in committed:
            self._leases.land(each.campaign, each.result.index)
            indices[each.worker, each.campaign].append(each.result.index)
        for (worker, campaign), safe in indices.items():
            if worker != HUB:
                self._send(worker, Ack(campaign, tuple(safe)))

    def drop(self, campaign: int) -> None:
        """Let all workers forget a campaign: they may hold what another hub leased of it."""
        for worker in self._leases.seats:
            self._drop(worker, campaign)

    def _drop(self, worker: bytes, campaign: int) -> None:
        self._leases.seats[worker].forget(campaign)
        self._send(worker, Drop(campaign))

    def assign(self, runs: Mapping[int, Run]) -> None:
        """Leave what is held where it is, hand out what waits, and before it what it needs."""
        self._adopt(runs)
        is_new = time.monotonic() - self._began_s < GREETING_S
        if is_new and any(run.resumed for run in runs.values()):
            return
        for assignment in self._leases.assign():
            self._prepare(assignment, runs[assignment.campaign])
            self._send(assignment.worker, Lease(assignment.campaign, assignment.tasks))

    def _adopt(self, runs: Mapping[int, Run]) -> None:
        def of_ours(campaign: int, task: EpisodeTask) -> bytes:
            return fingerprint(runs[campaign].order.setup, task)

        for worker, campaign in self._leases.adopt(of_ours):
            name = self._leases.seats[worker].name
            log.warning("worker holds another campaign", worker=name, campaign=campaign)
            self._drop(worker, campaign)

    def _prepare(self, assignment: Assignment, run: Run) -> None:
        worker, campaign = assignment.worker, assignment.campaign
        seat = self._leases.seats[worker]
        if campaign not in seat.setups:
            seat.setups.add(campaign)
            self._send(worker, Setup(campaign, run.order.setup))
        sources = (task.source for task in assignment.tasks)
        versions = {source.version for source in sources if isinstance(source, PolicySource)}
        for version in sorted(versions):
            if (campaign, version) not in seat.policies:
                seat.policies.add((campaign, version))
                self._send(worker, PolicyUpdate(campaign, run.policy(version)))

    def dismiss(self) -> None:
        """Send all workers home."""
        for worker in self._leases.seats:
            self._send(worker, Goodbye("The hub stops."))
