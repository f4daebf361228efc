"""The hub's side of the conversation with workers, message by message."""

import time
from collections import defaultdict
from collections.abc import Callable, Collection, Hashable, Iterable, Iterator, Mapping
from typing import Any

import msgspec
import structlog

from eigenfail.bridges import MAX_OFFER_BYTES
from eigenfail.errors import ProtocolError
from eigenfail.processes import COMMON_PROCESSOR
from eigenfail.values.episode import EpisodeTask, PolicySource
from eigenfail.values.operations import Versions
from eigenfail.versions import versions
from eigenfail.wire import messages
from eigenfail_services.hub import transport
from eigenfail_services.hub.commits import HUB, CommitQueue, JudgedResult
from eigenfail_services.hub.leases import Leases
from eigenfail_services.hub.metrics import Metrics
from eigenfail_services.hub.runs import CampaignRun
from eigenfail_services.hub.scheduler import Assignment
from eigenfail_services.hub.worker_table import WorkerSession

HEARTBEAT_S = 1.0
SILENCE_LIMIT_S = 10.0

ADOPTION_GRACE_S = 3.0
"""Time that a new hub waits for workers that hold episodes of resumed campaigns: their next
heartbeat is refused, and then they send a hello with their holdings."""

GOODBYE_INTERVAL_S = 30.0
"""Time before a goodbye is repeated, which may be lost on its way. A worker that got it leaves
within ten seconds."""

PACKAGE = "eigenfail"

log = structlog.get_logger()

Send = Callable[[bytes, messages.Message], None]


class AssemblerTable:
    """The assemblers of a hub, one for each connection, within a bound for all of them."""

    def __init__(self) -> None:
        self._assemblers: dict[Hashable, messages.Assembler] = {}
        self._held_bytes = 0

    def __len__(self) -> int:
        """Number of connections with an incomplete message."""
        return len(self._assemblers)

    def add(self, connection: Hashable, piece: messages.Piece) -> bytes | None:
        """Take a piece; return the message of that connection if it is complete now.

        If the bound is exceeded, the longest incomplete message is dropped.

        Raises:
            ProtocolError: the piece does not fit the size that it names.
        """
        assembler = self._assemblers.get(connection)
        if assembler is None:
            assembler = self._assemblers[connection] = messages.Assembler(messages.MAX_BYTES_TO_HUB)
        before = assembler.held_bytes
        try:
            return assembler.add(piece)
        finally:
            # Also after an error, which drops what was held.
            held_bytes = assembler.held_bytes
            self._held_bytes += held_bytes - before
            if not held_bytes:
                del self._assemblers[connection]
            elif self._held_bytes > messages.MAX_UNFINISHED_BYTES:
                self._drop(max(self._assemblers, key=self._size))

    def keep_only(self, connections: Collection[Hashable]) -> None:
        """Drop the incomplete messages of all other connections."""
        for gone in [each for each in self._assemblers if each not in connections]:
            self._drop(gone)

    def _drop(self, connection: Hashable) -> None:
        self._held_bytes -= self._size(connection)
        del self._assemblers[connection]

    def _size(self, connection: Hashable) -> int:
        return self._assemblers[connection].held_bytes


class Draining:
    """Workers that finish their leases and then leave, and when each was asked to."""

    def __init__(self) -> None:
        self._names: frozenset[str] = frozenset()
        self._told_s: dict[WorkerSession, float] = {}

    def set_names(self, names: Collection[str]) -> None:
        """Set the names of the workers that are to leave; any thread may call this."""
        self._names = frozenset(names)

    def find_workers(self, sessions: Mapping[bytes, WorkerSession]) -> list[bytes]:
        """Return the connections of the workers that are to leave."""
        names = self._names
        return [worker for worker, each in sessions.items() if each.name in names] if names else []

    def pop_ready(
        self, draining: list[bytes], sessions: Mapping[bytes, WorkerSession], now_s: float
    ) -> Iterator[bytes]:
        """Yield the workers without leases that can now leave.

        Args:
            draining: workers that are to leave.
            sessions: sessions of all workers.
            now_s: monotonic time. [s]
        """
        # Sessions, not names: a worker that came back under its name was not asked yet.
        connected = {sessions[worker] for worker in draining}
        self._told_s = {each: at_s for each, at_s in self._told_s.items() if each in connected}
        for worker in draining:
            session = sessions[worker]
            told_s = self._told_s.get(session, -GOODBYE_INTERVAL_S)
            if not session.held and now_s - told_s >= GOODBYE_INTERVAL_S:
                self._told_s[session] = now_s
                yield worker


class WorkerSessions:
    """Handles the messages of workers.

    Args:
        send: sends a message to a worker.
        leases: leases of all campaigns.
        commits: take the results.
        metrics: count lost workers.
        is_connected: returns whether a worker's connection is open.

    Attributes:
        declined: campaigns that a worker cannot run, with the reasons.
        prepared: campaigns whose setup was sent to a worker, with the versions of the worker.
    """

    def __init__(
        self,
        send: Send,
        leases: Leases,
        commits: CommitQueue,
        metrics: Metrics | None = None,
        is_connected: transport.IsConnected = lambda _worker: True,
    ) -> None:
        self._send = send
        self._probe = transport.ConnectionProbe(is_connected)
        self._metrics = metrics or Metrics()
        self._leases = leases
        self._commits = commits
        self._refusals = transport.RefusalLog()
        self._assemblers = AssemblerTable()
        self.declined: dict[int, str] = {}
        self.prepared: list[tuple[int, Versions]] = []
        self._began_s = self._expired_s = time.monotonic()
        self._handlers: dict[type, Callable[[bytes, Any], None]] = {
            messages.Hello: self._handle_hello,
            messages.Heartbeat: self._handle_heartbeat,
            messages.BridgeReport: self._handle_bridge_report,
            messages.Results: self._handle_results,
            messages.Goodbye: self._handle_goodbye,
            messages.Piece: self._handle_piece,
        }

    def handle(self, worker: bytes, data: bytes) -> None:
        """Handle any bytes of a worker."""
        try:
            message = messages.read_worker_message(data)
        except ProtocolError as error:
            hello = messages.read_foreign_hello(data)
            if hello and (reason := explain_refusal(hello.protocol, hello.versions)):
                self._refuse(worker, reason)
            else:
                self._send(worker, messages.Refusal(str(error)))
            return
        if not isinstance(message, messages.Hello) and not self._leases.touch(
            worker, time.monotonic()
        ):
            self._send(
                worker, messages.Refusal("The hub does not know this connection: say hello.")
            )
        else:
            self._handlers[type(message)](worker, message)

    def _handle_hello(self, worker: bytes, message: messages.Hello) -> None:
        if reason := explain_refusal(message.protocol, message.versions):
            self._refuse(worker, reason, named=message.worker, host=message.host)
            return
        session = self._leases.touch(worker, time.monotonic())
        # A hello is repeated until its welcome comes. To open the session again would take back
        # what was leased in between.
        if session is None or not session.was_opened_by(message):
            log.info("worker joined", worker=message.worker, host=message.host, pid=message.pid)
            _log_version_difference(message.worker, message.versions)
            self._leases.open_session(worker, message, time.monotonic())
        self._send(worker, messages.Welcome(HEARTBEAT_S))

    def _refuse(self, worker: bytes, reason: str, **facts: str) -> None:
        # A refused worker asks again and again: the log has one line for many refusals.
        self._refusals.add("another release or processor", why=reason, **facts)
        self._send(worker, messages.Refusal(reason))

    def _handle_heartbeat(self, worker: bytes, message: messages.Heartbeat) -> None:
        running = None
        if message.campaign is not None and message.running is not None:
            running = (message.campaign, message.running)
        self._leases.record_heartbeat(worker, running, set(message.held), message.slots)
        for campaign, reason in message.declined or ():
            self._decline(worker, campaign, reason)
        self._send(worker, transport.HEARTBEAT_ACK)

    def _decline(self, worker: bytes, campaign: int, reason: str) -> None:
        """Note that a worker can run no episode of a campaign, if it was sent the campaign's setup.

        Without a setup the campaign was dropped since then, and the worker is notified again.
        """
        session = self._leases.sessions[worker]
        if campaign in session.setups:
            problem = f"Worker {session.name} can run no episode of the campaign: {reason}"
            self.declined.setdefault(campaign, problem)
        else:
            self._drop(worker, campaign)

    def _handle_bridge_report(self, worker: bytes, message: messages.BridgeReport) -> None:
        session = self._leases.sessions[worker]
        session.offer = None
        if message.offer is None or not session.has_bridge:
            return
        data = msgspec.json.encode(message.offer)
        if len(data) <= MAX_OFFER_BYTES:
            session.offer = data.decode()
        else:
            facts = {"worker": session.name, "bytes": len(data), "most": MAX_OFFER_BYTES}
            log.warning("offer of a bridge not kept", **facts)

    def _handle_results(self, worker: bytes, message: messages.Results) -> None:
        name = self._leases.sessions[worker].name
        for result in message.results:
            self._leases.record_result(message.campaign, result.index, result.wall_s, worker)
            self._commits.add(worker, name, message.campaign, result)

    def _handle_piece(self, worker: bytes, piece: messages.Piece) -> None:
        """Keep a piece of a message, and handle the message once it is complete."""
        try:
            data = self._assemblers.add(worker, piece)
            message = None if data is None else messages.read_worker_message(data)
        except ProtocolError as error:
            self._send(worker, messages.Refusal(str(error)))
            return
        # A piece of pieces would get around the bounds of one assembler.
        if isinstance(message, messages.Piece):
            self._send(worker, messages.Refusal("A piece of a message holds another piece."))
        elif message is not None:
            self._handlers[type(message)](worker, message)

    def _handle_goodbye(self, worker: bytes, _message: messages.Goodbye) -> None:
        self._leases.end_session(worker)

    def expire_silent(self) -> None:
        """End the sessions of workers that were silent for long, or whose connections are closed.

        A late result of such a worker is still accepted.
        """
        now_s, before_s = time.monotonic(), self._expired_s
        self._expired_s = now_s
        if now_s - before_s > SILENCE_LIMIT_S / 2:  # the hub was held up by its store or its host
            self._leases.excuse_silence(now_s - before_s, now_s)
        for worker in self._leases.list_silent(now_s, SILENCE_LIMIT_S):
            self._record_loss(worker, why="it is silent")
            self._leases.end_lost_session(worker)
        quiet = self._leases.list_silent(now_s, transport.QUIET_HEARTBEATS * HEARTBEAT_S)
        for worker in self._probe.find_closed(quiet, now_s):
            self._record_loss(worker, why="its connection is closed")
            # It has until then to come back, which is as long as a silent worker has.
            heard_s = self._leases.sessions[worker].last_heard_s
            self._leases.end_disconnected_session(worker, heard_s + SILENCE_LIMIT_S)
        self._leases.expire_disconnected(now_s)
        self._assemblers.keep_only(self._leases.sessions)

    def _record_loss(self, worker: bytes, why: str) -> None:
        session = self._leases.sessions[worker]
        log.warning("worker lost", worker=session.name, held=len(session.held), why=why)
        self._metrics.workers_lost.inc()
        self._metrics.leases_expired.inc(len(session.held))

    def drain(self, draining: Draining) -> None:
        """Lease nothing more to the workers that are to leave, and dismiss those that are done."""
        sessions = self._leases.sessions
        leaving = draining.find_workers(sessions)
        for worker in leaving:
            self._leases.stop_leasing(worker)
        for worker in draining.pop_ready(leaving, sessions, time.monotonic()):
            log.info("worker dismissed", worker=sessions[worker].name)
            self._send(worker, messages.Goodbye("The worker is no longer needed."))

    def acknowledge(self, judged: Iterable[JudgedResult]) -> None:
        """Acknowledge the judged results to their workers: one message for each campaign."""
        indices: defaultdict[tuple[bytes, int], list[int]] = defaultdict(list)
        for each in judged:
            self._leases.record_verdict(each.campaign, each.result.index)
            indices[each.worker, each.campaign].append(each.result.index)
        for (worker, campaign), of_worker in indices.items():
            if worker != HUB:
                self._send(worker, messages.Ack(campaign, tuple(of_worker)))

    def drop_campaign(self, campaign: int) -> None:
        """Have all workers forget a campaign: they may hold leases of another hub, too."""
        for worker in self._leases.sessions:
            self._drop(worker, campaign)

    def _drop(self, worker: bytes, campaign: int) -> None:
        self._leases.sessions[worker].forget_campaign(campaign)
        self._send(worker, messages.Drop(campaign))

    def assign(self, runs: Mapping[int, CampaignRun]) -> None:
        """Adopt held episodes, lease waiting ones, and first send needed setups and policies."""
        # First: what a worker holds must not be leased to another one.
        self._adopt(runs)
        is_new = time.monotonic() - self._began_s < ADOPTION_GRACE_S
        if is_new and any(run.resumed for run in runs.values()):
            return
        for assignment in self._leases.assign():
            self._prepare(assignment, runs[assignment.campaign])
            self._send(assignment.worker, messages.Lease(assignment.campaign, assignment.tasks))

    def _adopt(self, runs: Mapping[int, CampaignRun]) -> None:
        def fingerprint(campaign: int, task: EpisodeTask) -> bytes:
            return messages.fingerprint_task(runs[campaign].spec.setup, task)

        for worker, campaign in self._leases.lease_held_episodes(fingerprint):
            name = self._leases.sessions[worker].name
            log.warning("worker holds another campaign", worker=name, campaign=campaign)
            self._drop(worker, campaign)

    def _prepare(self, assignment: Assignment, run: CampaignRun) -> None:
        """Send the setup and the policies that an assignment needs and the worker does not have."""
        worker, campaign = assignment.worker, assignment.campaign
        session = self._leases.sessions[worker]
        # A worker runs nothing before it has the setup of the campaign and the policies of the
        # tasks.
        if campaign not in session.setups:
            session.setups.add(campaign)
            self.prepared.append((campaign, session.arrival.versions))
            self._send(worker, messages.Setup(campaign, run.spec.setup))
        sources = (task.source for task in assignment.tasks)
        needed = {source.version for source in sources if isinstance(source, PolicySource)}
        for version in sorted(needed):
            if (campaign, version) not in session.policies:
                session.policies.add((campaign, version))
                self._send(worker, messages.PolicyUpdate(campaign, run.find_policy(version)))

    def dismiss_all(self) -> None:
        """Send all workers the request to leave."""
        for worker in self._leases.sessions:
            self._send(worker, messages.Goodbye("The hub stops."))


def explain_refusal(protocol: int, worker_versions: Mapping[str, str]) -> str:
    """Return why a worker of this protocol and these versions is refused; empty if it is not.

    The worker must speak the same protocol and have the same release as the hub. Only the last
    number of the versions may differ: it counts corrections that do not change the results of
    episodes. The worker's processor must compute as the hub's does, bit for bit.
    """
    ours, theirs = versions().get(PACKAGE, ""), worker_versions.get(PACKAGE, "")
    is_same_release = not theirs or theirs.split(".")[:2] == ours.split(".")[:2]
    if protocol == messages.PROTOCOL and is_same_release:
        return _explain_processor(worker_versions.get("processor", ""))
    of_release = f" (eigenfail {theirs})" if theirs else ""
    return (
        f"The worker speaks protocol {protocol}{of_release}, the hub speaks {messages.PROTOCOL} "
        f"(eigenfail {ours}): install the same eigenfail on both."
    )


def _explain_processor(theirs: str) -> str:
    """Return why a worker with this processor is refused; empty if it is not, or is unknown."""
    ours = versions()["processor"]
    if theirs in {"", ours} or not ours:
        return ""
    return (
        f'The worker\'s processor is "{theirs}", the hub\'s "{ours}": their results differ in the '
        "last bits, so that a campaign would run other episodes on each. Run services and workers "
        f"on processors of one kind, best on {COMMON_PROCESSOR}: all of those compute alike."
    )


def _log_version_difference(worker: str, worker_versions: Mapping[str, str]) -> None:
    ours, theirs = versions().get(PACKAGE, ""), worker_versions.get(PACKAGE, "")
    if theirs not in {"", ours}:
        log.warning("worker of another version", worker=worker, worker_has=theirs, hub_has=ours)
