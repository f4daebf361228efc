"""The hub's side of the talk with workers: who is in, what each was told, what each brings."""

import time
from collections.abc import Callable, Mapping
from typing import Any

import structlog

from eigenfail.errors import ProtocolError
from eigenfail.values import EpisodeFault, PolicySource, unrunnable
from eigenfail.wire.messages import (
    PROTOCOL,
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
from eigenfail_services.hub.leases import Assignment, Leases
from eigenfail_services.hub.runs import Run

HEARTBEAT_S = 1.0
SILENCE_LIMIT_S = 10.0
HUB = b"hub"

log = structlog.get_logger()

Send = Callable[[bytes, Message], None]


class Desk:
    """Answers workers. Messages leave through `send`; results go to `commits`."""

    def __init__(self, send: Send, leases: Leases, commits: Commits) -> None:
        self._send = send
        self._leases = leases
        self._commits = commits
        self._setups: dict[bytes, set[int]] = {}
        self._policies: dict[bytes, set[tuple[int, int]]] = {}
        self._looked_s = time.monotonic()
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
            self._send(worker, Refusal(str(error)))
            return
        if not isinstance(message, Hello) and not self._leases.heard(worker, time.monotonic()):
            self._send(worker, Refusal("The hub does not know this connection: say hello."))
        else:
            self._handlers[type(message)](worker, message)

    def _hello(self, worker: bytes, message: Hello) -> None:
        if message.protocol != PROTOCOL:
            versions = f"worker speaks protocol {message.protocol}, hub speaks {PROTOCOL}"
            self._send(worker, Refusal(f"The {versions}: install the same eigenfail on both."))
            return
        log.info("worker joined", worker=message.worker, host=message.host, pid=message.pid)
        if self._leases.heard(worker, time.monotonic()):  # who speaks has not died of anything
            self._leases.running(worker, None, None)
        self._lose(worker)
        self._leases.join(worker, message.worker, message.credit, time.monotonic())
        self._setups[worker] = set()
        self._policies[worker] = set()
        self._send(worker, Welcome(HEARTBEAT_S))

    def _heartbeat(self, worker: bytes, message: Heartbeat) -> None:
        self._leases.running(worker, message.campaign, message.running)

    def _results(self, worker: bytes, message: Results) -> None:
        name = self._leases.seats[worker].name
        for result in message.results:
            self._leases.settle(message.campaign, result.index, result.wall_s)
            self._commits.add(worker, name, message.campaign, result)

    def _goodbye(self, worker: bytes, _message: Goodbye) -> None:
        self._leases.running(worker, None, None)
        self._lose(worker)

    def _lose(self, worker: bytes) -> None:
        self._setups.pop(worker, None)
        self._policies.pop(worker, None)
        for campaign, task in self._leases.leave(worker):
            fault = EpisodeFault("infrastructure", "Three workers were lost while they ran it.")
            self._commits.add(HUB, HUB.decode(), campaign, unrunnable(task, fault))

    def bury_silent(self) -> None:
        """Give up the workers that were not heard for long; a late result is still welcome."""
        now_s, before_s = time.monotonic(), self._looked_s
        self._looked_s = now_s
        if now_s - before_s > SILENCE_LIMIT_S / 2:  # the hub was held up, by its store or its host
            self._leases.excuse(now_s - before_s, now_s)
        for worker in self._leases.silent(now_s, SILENCE_LIMIT_S):
            log.warning("worker lost", worker=self._leases.seats[worker].name)
            self._lose(worker)

    def acknowledge(self, committed: Committed) -> None:
        """Tell the worker that its result is safe."""
        if committed.worker != HUB:
            self._send(committed.worker, Ack(committed.campaign, (committed.result.index,)))

    def drop(self, campaign: int) -> None:
        """Let all workers forget a campaign."""
        for worker, setups in self._setups.items():
            if campaign in setups:
                setups.discard(campaign)
                self._policies[worker] = {p for p in self._policies[worker] if p[0] != campaign}
                self._send(worker, Drop(campaign))

    def assign(self, runs: Mapping[int, Run]) -> None:
        """Hand out what waits, and before it what a worker needs to run it."""
        for assignment in self._leases.assign():
            self._prepare(assignment, runs[assignment.campaign])
            self._send(assignment.worker, Lease(assignment.campaign, assignment.tasks))

    def _prepare(self, assignment: Assignment, run: Run) -> None:
        worker, campaign = assignment.worker, assignment.campaign
        if campaign not in self._setups[worker]:
            self._setups[worker].add(campaign)
            self._send(worker, Setup(campaign, run.order.setup))
        sources = (task.source for task in assignment.tasks)
        versions = {source.version for source in sources if isinstance(source, PolicySource)}
        for version in sorted(versions):
            if (campaign, version) not in self._policies[worker]:
                self._policies[worker].add((campaign, version))
                self._send(worker, PolicyUpdate(campaign, run.policy(version)))

    def dismiss(self) -> None:
        """Send all workers home."""
        for worker in self._leases.seats:
            self._send(worker, Goodbye("The hub stops."))
