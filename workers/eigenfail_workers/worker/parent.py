"""The outer process of a worker: it speaks with the hub, and survives whatever its child does."""

import os
import platform
import time
from collections import deque
from collections.abc import Callable, Iterator
from itertools import chain, islice
from uuid import uuid4

import structlog
import zmq
from msgspec.structs import replace

from eigenfail.bridges import ADDRESS_VARIABLE
from eigenfail.errors import ServiceError
from eigenfail.values import EpisodeFault, EpisodeResult, unrunnable
from eigenfail.versions import versions
from eigenfail.wire.claims import MAX_CLAIMS, Claim, fingerprint
from eigenfail.wire.curve import WorkerKey
from eigenfail.wire.messages import (
    PROTOCOL,
    Ack,
    Drop,
    Goodbye,
    Heartbeat,
    Hello,
    Lease,
    PolicyUpdate,
    Refusal,
    Results,
    Setup,
    Welcome,
)
from eigenfail_workers.episode_limit import read_episode_limit
from eigenfail_workers.worker.child_process import ChildProcess, Held
from eigenfail_workers.worker.deaths import MAX_CHILD_DEATHS, Deaths
from eigenfail_workers.worker.ending import Ending
from eigenfail_workers.worker.limits import Limits, read_limits
from eigenfail_workers.worker.link import Link
from eigenfail_workers.worker.supplies import Supplies
from eigenfail_workers.worker.unborn import Unborn

CREDIT = 256
TICK_MS = 100
HELLO_EVERY_S = 1.0
MAX_UNANSWERED = 20
"""Heartbeats or hellos in a row, after which the line to the hub is made anew."""

log = structlog.get_logger()


class Parent:
    """Holds leased episodes, feeds them to a child, and keeps results until the hub has them.

    Args:
        address: of the hub, as `tcp://host:port`.
        name: how the worker is called in lists and logs.
        episode_limit_s: wall time after which a running episode is given up and its child killed;
            None takes that of the environment.
        key: what it shows to a hub that asks for one.
        limits: what its child may take; None takes those of the environment.

    Raises:
        InvalidValue: the address is none, or the environment's limits are none.
    """

    def __init__(
        self,
        address: str,
        name: str,
        episode_limit_s: float | None = None,
        key: WorkerKey | None = None,
        limits: Limits | None = None,
    ) -> None:
        self._episode_limit_s = episode_limit_s or read_episode_limit()
        confined = limits or read_limits(episode_limit_s=self._episode_limit_s)
        self._limits = replace(confined, episode_s=self._episode_limit_s)
        self._link = Link(address, key)
        self._hello = Hello(
            PROTOCOL,
            name,
            CREDIT,
            platform.node(),
            os.getpid(),
            life=uuid4().hex,
            versions=versions(),
            bridge=bool(os.environ.get(ADDRESS_VARIABLE)),
        )
        self._waiting: deque[Held] = deque()
        self._outbox: dict[tuple[int, int], EpisodeResult] = {}
        self._supplies = Supplies()
        self._deaths = Deaths()
        self._child = self._start_child()
        self._poller = zmq.Poller()
        self._heard: ChildProcess | None = None
        self._heartbeat_s = 0.0
        self._refusal = ""
        self._next_beat_s = 0.0
        self._unanswered = 0
        self._ending = Ending()
        self._handlers: dict[type, Callable[..., None]] = {
            Welcome: self._welcome,
            Refusal: self._refused,
            Setup: self._supplies.set_up,
            PolicyUpdate: self._supplies.learn,
            Lease: self._lease,
            Ack: self._forget,
            Drop: self._drop,
            Goodbye: self._leave,
        }

    def serve(self) -> None:
        """Work until the hub says goodbye or `leave` is called.

        Raises:
            Unauthorized: the hub does not let this worker in.
            ServiceUnreachable: whoever listens at its address is not the hub.
            ServiceError: no inner process can start here.
        """
        try:
            while not self._ending.wanted:
                self.turn(child_spoke=self._wait())
            self._hand_over()
        finally:
            self._link.send(Goodbye("stopped"))
            self._child.end()
            self._link.close()
        self._ending.raise_problem()

    def turn(self, child_spoke: bool) -> None:
        """Do what is to be done now; never waits."""
        self._hear_hub()
        self._hear_child(child_spoke)
        self._feed_child()
        self._beat()

    def leave(self) -> None:
        """Stop after the current turn of the loop; safe to call from a signal handler.

        What runs is abandoned; what is finished is handed over, for which the hub has ten seconds.
        A second call ends that patience.
        """
        self._ending.ask()

    def _hand_over(self) -> None:
        """Run nothing more, and wait for the acknowledgement of what was handed in."""
        if self._ending.problem is None:
            self._listen()
        self._child.end()
        self._child.running.clear()
        self._waiting.clear()
        self._handlers[Lease] = self._decline
        while self._outbox and self._ending.is_patient:
            self._link.socket.poll(TICK_MS)
            self._hear_hub()
            self._beat()
        if self._outbox:
            log.warning("not acknowledged", worker=self._hello.worker, results=len(self._outbox))

    def _wait(self) -> bool:
        """For a word of the hub or of the child, but not for long; whether the child spoke."""
        if self._heard is not self._child:
            self._heard, self._poller = self._child, zmq.Poller()
            self._poller.register(self._link.socket, zmq.POLLIN)
            self._poller.register(self._child.descriptor, zmq.POLLIN)
        return self._child.descriptor in dict(self._poller.poll(TICK_MS))

    def _hear_hub(self) -> None:
        for message in self._link.receive():
            self._unanswered = 0
            self._handlers[type(message)](message)

    def _welcome(self, message: Welcome) -> None:
        if self._heartbeat_s:
            return  # one for each hello that waited for the hub to come up
        log.info("welcomed", worker=self._hello.worker, hub=self._link.address)
        self._heartbeat_s, self._refusal = message.heartbeat_s, ""
        self._hello = replace(self._hello, asked=self._hello.asked + 1)
        for (campaign, _), result in self._outbox.items():
            self._link.send(Results(campaign, (result,)))

    def _refused(self, message: Refusal) -> None:
        """The hub does not know us (it was restarted, or we were given up): introduce again."""
        if message.reason != self._refusal:
            said = log.info if self._heartbeat_s else log.warning  # a hello was refused, else
            said("refused, trying again", worker=self._hello.worker, reason=message.reason)
        if self._heartbeat_s:
            self._next_beat_s = 0.0  # before the hub has given up who had this worker's last line
        self._refusal, self._heartbeat_s = message.reason, 0.0

    def _lease(self, message: Lease) -> None:
        mine = {(each.campaign, each.task.index) for each in self._held()}
        for task in message.tasks:
            key = (message.campaign, task.index)
            if key in self._outbox:
                self._link.send(Results(message.campaign, (self._outbox[key],)))
            elif key not in mine and min(key) >= 0:  # else no hello could name it
                self._waiting.append(Held(message.campaign, task))

    def _decline(self, _message: Lease) -> None:
        """It goes to others, when the hub has heard the goodbye."""

    def _forget(self, message: Ack) -> None:
        for index in message.indices:
            self._outbox.pop((message.campaign, index), None)

    def _drop(self, message: Drop) -> None:
        self._waiting = deque(held for held in self._waiting if held.campaign != message.campaign)
        self._supplies.drop(message.campaign)
        self._child.drop(message.campaign)

    def _leave(self, message: Goodbye) -> None:
        log.info("sent home", worker=self._hello.worker, reason=message.reason)
        self._ending.ask()

    def _hear_child(self, spoke: bool) -> None:
        ended = self._child.has_ended()  # first: what it wrote before is all there then
        alive = self._listen() if spoke or ended else True
        if ended or not alive:
            self._replace_child("killed its process", 1 if self._child.begun else 0)
        elif self._child.overdue(self._episode_limit_s):
            weight = MAX_CHILD_DEATHS if self._child.ready else 0
            self._replace_child(f"took longer than {self._episode_limit_s:g} s", weight)
        elif excess := self._child.excess():
            self._replace_child(excess, 1)

    def _listen(self) -> bool:
        """Report what the child has finished; whether it lives."""
        alive, results = self._child.listen()
        for campaign, result in results:
            self._deaths.brought(campaign, result.index)
            self._report(campaign, result)
        return alive

    def _report(self, campaign: int, result: EpisodeResult) -> None:
        self._outbox[campaign, result.index] = result
        self._link.send(Results(campaign, (result,)))

    def _start_child(self) -> ChildProcess:
        try:
            return ChildProcess(self._limits)
        except ServiceError as error:
            log.warning("no child, trying again", worker=self._hello.worker, why=str(error))
            return Unborn()

    def _replace_child(self, what: str, weight: int) -> None:
        """Start a new child; the episode that was running is tried again, but not for ever."""
        status, held = self._child.end(), list(self._child.running)
        try:
            self._deaths.lost(ready=self._child.ready, status=status)
        except ServiceError as error:
            self._ending.ask_because(error)
            return
        self._child = self._start_child()
        self._waiting.extendleft(filter(self._supplies.suffice, reversed(held[1:])))
        facts = {"campaign": held[0].campaign, "episode": held[0].task.index} if held else {}
        log.warning("child replaced", worker=self._hello.worker, status=status, why=what, **facts)
        if held and self._supplies.suffice(held[0]):
            self._blame(held[0], f"The episode {what} (exit status {status}).", weight)

    def _blame(self, held: Held, message: str, weight: int) -> None:
        """Count a death against an episode; one that had not begun when it happened weighs 0."""
        if not self._deaths.spent(held, weight):
            self._waiting.appendleft(held)
            return
        remedy = "Replay it alone with `eigenfail episode replay` to see where it stays or dies."
        fault = EpisodeFault("infrastructure", f"{message} {remedy}")
        self._report(held.campaign, unrunnable(held.task, fault))

    def _feed_child(self) -> None:
        while self._waiting and self._child.has_room:
            held = self._waiting.popleft()
            if not self._supplies.suffice(held):  # it went astray: the hub begins with us anew
                self._heartbeat_s = 0.0
                continue
            self._supplies.prepare(self._child, held)
            self._child.run(held)

    def _beat(self) -> None:
        now = time.monotonic()
        if now < self._next_beat_s:
            return
        self._unanswered += 1
        if self._unanswered > MAX_UNANSWERED:
            self._connect_again()
        if not self._heartbeat_s:
            self._link.send(replace(self._hello, claims=self._claims()))
            self._next_beat_s = now + HELLO_EVERY_S
            return
        self._link.send(self._heartbeat())
        self._next_beat_s = now + self._heartbeat_s

    def _heartbeat(self) -> Heartbeat:
        named = ((each.campaign, each.task.index) for each in self._held())
        held = tuple(islice(named, MAX_CLAIMS))
        if not self._child.running:
            return Heartbeat(held=held)
        running = self._child.running[0]
        slots = self._child.slots(running.campaign)
        return Heartbeat(running.campaign, running.task.index, held, slots)

    def _connect_again(self) -> None:
        log.warning("no answer", worker=self._hello.worker, hub=self._link.address)
        self._link.connect_again()
        self._unanswered, self._heartbeat_s = 0, 0.0

    def _held(self) -> Iterator[Held]:
        """All that it will run, or runs; what was dropped is nobody's any more."""
        return (each for each in (*self._child.running, *self._waiting) if each.wanted)

    def _claims(self) -> tuple[Claim, ...]:
        """What a hub that does not know us is to leave here."""
        setups = self._supplies.setups
        unfinished = (
            Claim(each.campaign, each.task.index, fingerprint(setups[each.campaign], each.task))
            for each in self._held()
            if each.campaign in setups
        )
        finished = (Claim(*key) for key in self._outbox)
        return tuple(islice(chain(unfinished, finished), MAX_CLAIMS))
