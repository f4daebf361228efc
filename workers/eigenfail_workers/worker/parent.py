"""The parent process of a worker: it talks to the hub, and survives the end of its child."""

import os
import platform
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from itertools import chain, islice
from uuid import uuid4

import structlog
import zmq
from msgspec import UNSET
from msgspec.structs import replace

from eigenfail.bridges import ADDRESS_VARIABLE
from eigenfail.errors import ProtocolError, ServiceError
from eigenfail.values import episode
from eigenfail.versions import fingerprint_plugins, versions
from eigenfail.wire import messages
from eigenfail.wire.keys import WorkerKey
from eigenfail.worlds import world_of
from eigenfail_workers.bridge.probe import make_probe
from eigenfail_workers.limits import RENEWAL, Limits, read_limits
from eigenfail_workers.worker import inner_processes
from eigenfail_workers.worker.child_process import ChildProcess, HeldEpisode, NullChild
from eigenfail_workers.worker.hub_connection import HubConnection

HAND_OVER_S = 10.0
"""Time for the hub to acknowledge finished results while the worker shuts down."""

CREDIT = 256
TICK_MS = 100
HELLO_EVERY_S = 1.0
BEATS_PER_REPORT = 10
"""Heartbeats after which the offer of the bridge is reported again, as a report may be lost."""

MAX_UNANSWERED = 20
"""Heartbeats or hellos without an answer in a row, after which the worker reconnects."""

log = structlog.get_logger()


class Shutdown:
    """State of a shutdown, not requested at first.

    Attributes:
        requested: whether no further episode may run.
        problem: error that has caused the shutdown; None if it was requested from outside.
    """

    def __init__(self) -> None:
        self.requested = False
        self.problem: ServiceError | None = None
        self._until_s = 0.0

    def request(self, problem: ServiceError | None = None) -> None:
        """Request a shutdown; a second request from outside skips the wait for the hub.

        Safe to call from a signal handler.

        Args:
            problem: error that prevents the worker from going on.
        """
        self.problem = problem or self.problem
        if not self.requested:
            self._until_s = time.monotonic() + HAND_OVER_S
        elif problem is None:
            self._until_s = 0.0
        self.requested = True

    @property
    def has_time(self) -> bool:
        """True if the worker may go on waiting for the hub."""
        return time.monotonic() < self._until_s


class Parent:
    """Holds leased episodes, sends them to a child, and keeps results until the hub has them.

    Args:
        address: address of the hub, as `tcp://host:port`.
        name: name of the worker in lists and logs.
        key: for a hub that requires keys.
        limits: limits for an episode and its child process; default: from the environment.

    Raises:
        InvalidValue: the address or a limit in the environment is not valid.
    """

    def __init__(
        self,
        address: str,
        name: str,
        key: WorkerKey | None = None,
        limits: Limits | None = None,
    ) -> None:
        self._limits = limits or read_limits()
        self._hub = HubConnection(address, key)
        self._probe = make_probe(os.environ.get(ADDRESS_VARIABLE))
        self._hello = messages.Hello(
            messages.PROTOCOL,
            name,
            CREDIT,
            platform.node(),
            os.getpid(),
            life=uuid4().hex,
            versions=versions() | fingerprint_plugins(),
            bridge=bool(os.environ.get(ADDRESS_VARIABLE)),
        )
        self._waiting: deque[HeldEpisode] = deque()
        self._outbox: dict[tuple[int, int], episode.EpisodeResult] = {}
        self._declined: dict[int, str] = {}
        self._setups = inner_processes.CampaignSetups()
        self._failures = inner_processes.ProcessFailures()
        self._processes = inner_processes.InnerProcesses(self._start_child, self._limits)
        self._poller = zmq.Poller()
        self._polled_child: ChildProcess | None = None
        self._heartbeat_s = 0.0
        self._refusal = ""
        self._next_beat_s = 0.0
        self._beats = 0
        self._unanswered = 0
        self._shutdown = Shutdown()
        self._handlers: dict[type, Callable[..., None]] = {
            messages.Welcome: self._handle_welcome,
            messages.Refusal: self._handle_refusal,
            messages.Setup: self._handle_setup,
            messages.PolicyUpdate: self._setups.add_policy,
            messages.Lease: self._handle_lease,
            messages.Ack: self._handle_ack,
            messages.Drop: self._handle_drop,
            messages.Goodbye: self._handle_goodbye,
            # An incomplete message has answered the heartbeats, and needs nothing else.
            messages.Piece: _ignore,
        }

    @property
    def _child(self) -> ChildProcess:
        """The child process that takes episodes."""
        return self._processes.active

    def serve(self) -> None:
        """Work until the hub says goodbye or `shut_down` is called.

        Raises:
            Unauthorized: the hub does not accept this worker.
            ServiceUnreachable: what listens at the address is not the hub.
            ServiceError: no child process can start here.
        """
        try:
            while not self._shutdown.requested:
                self.turn(child_spoke=self._wait())
            self._hand_over()
        finally:
            self._hub.send(messages.Goodbye("stopped"))
            self._processes.end()
            self._hub.close()
            if self._probe is not None:
                self._probe.close()
        if self._shutdown.problem is not None:
            raise self._shutdown.problem

    def turn(self, child_spoke: bool) -> None:
        """Process new messages, and send due ones, without waiting."""
        self._listen_to_hub()
        self._supervise_child(child_spoke)
        self._processes.clean_up()
        self._feed_child()
        self._send_heartbeat()
        self._ask_bridge()

    def shut_down(self) -> None:
        """Stop after the current turn of the loop; safe to call from a signal handler.

        Episodes that run are abandoned; the hub has ten seconds to acknowledge finished results. A
        second call skips that time.
        """
        self._shutdown.request()

    def _hand_over(self) -> None:
        """Run nothing more, and wait until the hub has acknowledged the results."""
        # Results that the child has already written are whole episodes: they are kept.
        if self._shutdown.problem is None:
            self._listen_to_child()
        self._processes.end()
        self._child.running.clear()
        self._waiting.clear()
        self._handlers[messages.Lease] = _ignore  # the hub leases it elsewhere after the goodbye
        while self._outbox and self._shutdown.has_time:
            self._hub.socket.poll(TICK_MS)
            self._listen_to_hub()
            self._send_heartbeat()
        if self._outbox:
            log.warning("not acknowledged", worker=self._hello.worker, results=len(self._outbox))

    def _wait(self) -> bool:
        """Wait shortly for a message of the hub or the child; return whether the child has sent."""
        if self._polled_child is not self._child:
            self._polled_child, self._poller = self._child, zmq.Poller()
            self._poller.register(self._hub.socket, zmq.POLLIN)
            self._poller.register(self._child.descriptor, zmq.POLLIN)
        return self._child.descriptor in dict(self._poller.poll(TICK_MS))

    def _listen_to_hub(self) -> None:
        for message in self._hub.receive():
            self._unanswered = 0
            self._handlers[type(message)](message)

    def _handle_welcome(self, message: messages.Welcome) -> None:
        if self._heartbeat_s:
            return  # one for each hello that was queued while the hub started
        log.info("welcomed", worker=self._hello.worker, hub=self._hub.address)
        self._heartbeat_s, self._refusal = message.heartbeat_s, ""
        self._hello = replace(self._hello, asked=self._hello.asked + 1)
        # A new session, or a new hub, has not acknowledged them.
        for (campaign, _), result in self._outbox.items():
            self._hub.send(messages.Results(campaign, (result,)))
        self._report_offer()

    def _handle_refusal(self, message: messages.Refusal) -> None:
        """Say hello again: the hub was restarted, or has dropped this worker."""
        if message.reason != self._refusal:
            write = log.info if self._heartbeat_s else log.warning  # a refused hello is unexpected
            write("refused, trying again", worker=self._hello.worker, reason=message.reason)
        if self._heartbeat_s:
            # At once, before the hub gives up the session of this worker's last connection.
            self._next_beat_s = 0.0
        self._refusal, self._heartbeat_s = message.reason, 0.0

    def _handle_setup(self, message: messages.Setup) -> None:
        if message.campaign in self._declined:
            # A hub sends a setup again only after a drop, and the drop did not arrive: the campaign
            # was resumed, and the reason for which it was declined may be gone.
            self._handle_drop(messages.Drop(message.campaign))
        self._setups.set_up(message)

    def _handle_lease(self, message: messages.Lease) -> None:
        if message.campaign in self._declined:
            return  # the lease was sent before the hub knew
        # A hub that has restarted may lease again what runs here: it must not run twice.
        mine = {(each.campaign, each.task.index) for each in self._list_held()}
        for task in message.tasks:
            key = (message.campaign, task.index)
            # The result was lost on its way: it is sent again, and the episode is not run again.
            if key in self._outbox:
                self._hub.send(messages.Results(message.campaign, (self._outbox[key],)))
            elif key not in mine and min(key) >= 0:  # a hello cannot name a negative number
                self._waiting.append(HeldEpisode(message.campaign, task))

    def _handle_ack(self, message: messages.Ack) -> None:
        for index in message.indices:
            self._outbox.pop((message.campaign, index), None)

    def _handle_drop(self, message: messages.Drop) -> None:
        self._waiting = deque(held for held in self._waiting if held.campaign != message.campaign)
        self._declined.pop(message.campaign, None)
        self._setups.drop(message.campaign)
        self._processes.drop(message.campaign)

    def _handle_goodbye(self, message: messages.Goodbye) -> None:
        log.info("sent home", worker=self._hello.worker, reason=message.reason)
        self._shutdown.request()

    def _supervise_child(self, spoke: bool) -> None:
        # Asked before listening: after the end of the process all that it wrote can be read.
        ended = self._child.has_ended()
        alive = self._listen_to_child() if spoke or ended else True
        if ended or not alive:
            self._replace_child("killed its process", 1 if self._child.begun else 0)
        elif self._child.is_overdue(self._limits.episode_s):
            # An episode that hung would hang again for as long: it is given up at once. A process
            # that was never ready has not begun it.
            weight = inner_processes.MAX_CHILD_DEATHS if self._child.ready else 0
            self._replace_child(f"took longer than {self._limits.episode_s:g} s", weight)
        elif excess := self._child.find_excess():
            self._replace_child(excess, 1)

    def _listen_to_child(self) -> bool:
        """Report the results of the child; return whether the child is sound."""
        alive, results = self._child.listen()
        for campaign, result in results:
            self._failures.record_result(campaign, result.index)
            self._report(campaign, result)
        if self._child.declined.keys() - self._declined.keys():
            self._decline_campaigns(self._child.declined)
        return alive

    def _decline_campaigns(self, campaigns: Mapping[int, str]) -> None:
        """Report to the hub at once, and with every heartbeat until it drops these campaigns."""
        for campaign in campaigns.keys() - self._declined.keys():
            log.warning("campaign declined", campaign=campaign, reason=campaigns[campaign])
        self._declined |= campaigns
        self._waiting = deque(held for held in self._waiting if held.campaign not in campaigns)
        self._next_beat_s = 0.0

    def _report(self, campaign: int, result: episode.EpisodeResult) -> None:
        try:
            self._hub.send(messages.Results(campaign, (result,)))
        except ProtocolError as error:
            remedy = "Let the simulator end its episodes earlier, or show fewer vehicles."
            fault = episode.EpisodeFault("simulator", f"The result is too long. {error} {remedy}")
            task = episode.EpisodeTask(result.index, result.seed, episode.PriorSource())
            result = replace(
                episode.unrunnable(task, fault), source=result.source, wall_s=result.wall_s
            )
            self._hub.send(messages.Results(campaign, (result,)))
        self._outbox[campaign, result.index] = result

    def _start_child(self) -> ChildProcess:
        try:
            return ChildProcess(self._limits)
        except ServiceError as error:
            log.warning("no child, trying again", worker=self._hello.worker, why=str(error))
            return NullChild()

    def _replace_child(self, what: str, weight: int) -> None:
        """Start a new child, and run its episodes again; the first one counts a death.

        Args:
            what: action of the first episode, as the predicate of a sentence.
            weight: number of deaths to count against it; 0 if it had not begun.
        """
        status, held = self._child.end(), list(self._child.running)
        if status == RENEWAL and not self._child.begun:
            what = "was to run in a fresh process"
        try:
            self._failures.record_end(ready=self._child.ready, status=status)
        except ServiceError as error:
            self._shutdown.request(error)
            return
        self._processes.replace()
        # They had begun beside the one that is blamed, or waited: they run again without a mark.
        self._waiting.extendleft(filter(self._setups.can_run, reversed(held[1:])))
        facts = {"campaign": held[0].campaign, "episode": held[0].task.index} if held else {}
        log.warning("child replaced", worker=self._hello.worker, status=status, why=what, **facts)
        if not held or not self._setups.can_run(held[0]):
            return
        if not self._failures.blame(held[0], weight):
            self._waiting.appendleft(held[0])
            return
        message = f"The episode {what} (exit status {status})."
        remedy = "Replay it alone with `eigenfail episode replay` to see where it stays or dies."
        fault = episode.EpisodeFault("infrastructure", f"{message} {remedy}")
        self._report(held[0].campaign, episode.unrunnable(held[0].task, fault))

    def _feed_child(self) -> None:
        while self._waiting and self._child.has_room:
            held = self._waiting[0]
            if not self._setups.can_run(held):
                # A setup or a policy was lost: a new hello makes the hub send all of it again.
                self._heartbeat_s = 0.0
                self._waiting.popleft()
                continue
            group = inner_processes.find_group(held.campaign, self._setups.setups[held.campaign])
            if not (self._processes.select(group) and self._child.has_room):
                return
            self._waiting.popleft()
            self._setups.run_in(self._child, held)

    def _send_heartbeat(self) -> None:
        """Send a heartbeat, or a hello until the hub has welcomed this worker, when it is due."""
        now = time.monotonic()
        if now < self._next_beat_s:
            return
        self._unanswered += 1
        if self._unanswered > MAX_UNANSWERED:
            log.warning("no answer", worker=self._hello.worker, hub=self._hub.address)
            self._hub.reconnect()
            # A new connection begins with a hello: the hub may be another one.
            self._unanswered, self._heartbeat_s = 0, 0.0
        if not self._heartbeat_s:
            self._hub.send(replace(self._hello, holdings=self._list_holdings()))
            self._next_beat_s = now + HELLO_EVERY_S
            return
        self._hub.send(self._make_heartbeat())
        self._beats += 1
        if self._beats % BEATS_PER_REPORT == 0:
            self._report_offer()
        self._next_beat_s = now + self._heartbeat_s

    def _ask_bridge(self) -> None:
        """Find out what the bridge offers, while no campaign of this worker runs on it."""
        if self._probe is None:
            return
        setups = self._setups.setups.values()
        is_used = any(world_of(setup.simulator).needs_bridge for setup in setups)
        if self._probe.update(may_ask=not is_used) and self._heartbeat_s:
            self._report_offer()

    def _report_offer(self) -> None:
        """Report what the bridge offers to the hub, which forgets it with the session."""
        if self._probe is not None:
            self._hub.send(messages.BridgeReport(self._probe.offer))

    def _make_heartbeat(self) -> messages.Heartbeat:
        named = ((each.campaign, each.task.index) for each in self._list_held())
        held = tuple(islice(named, messages.MAX_HOLDINGS))
        declined = tuple(islice(self._declined.items(), messages.MAX_HOLDINGS)) or UNSET
        if not self._child.running:
            return messages.Heartbeat(held=held, declined=declined)
        running = self._child.running[0]
        slots = self._child.slots(running.campaign)
        return messages.Heartbeat(running.campaign, running.task.index, held, slots, declined)

    def _list_held(self) -> Iterator[HeldEpisode]:
        """Yield the running and waiting episodes, except episodes of dropped campaigns."""
        return (each for each in (*self._child.running, *self._waiting) if each.wanted)

    def _list_holdings(self) -> tuple[messages.Holding, ...]:
        """Return the episodes that a hub which does not know this worker must leave to it."""
        setups = self._setups.setups
        unfinished = (
            messages.Holding(
                each.campaign,
                each.task.index,
                messages.fingerprint_task(setups[each.campaign], each.task),
            )
            for each in self._list_held()
            if each.campaign in setups
        )
        finished = (messages.Holding(*key) for key in self._outbox)
        return tuple(islice(chain(unfinished, finished), messages.MAX_HOLDINGS))


def _ignore(_message: object) -> None:
    """Handle a message that needs no action."""
