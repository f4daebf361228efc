"""The outer process of a worker: it speaks with the hub, and survives whatever its child does."""

import os
import platform
import time
from collections import deque
from collections.abc import Callable

import structlog
import zmq

from eigenfail.values import (
    EpisodeFault,
    EpisodeResult,
    EpisodeSetup,
    Policy,
    PolicySource,
    unrunnable,
)
from eigenfail.wire.messages import (
    PROTOCOL,
    Ack,
    Drop,
    Goodbye,
    Heartbeat,
    Hello,
    HubMessage,
    Lease,
    PolicyUpdate,
    Refusal,
    Results,
    Setup,
    Welcome,
)
from eigenfail_workers.worker.child_process import ChildProcess, Held
from eigenfail_workers.worker.link import Link

CREDIT = 256
MAX_CHILD_DEATHS = 3
MAX_FALSE_STARTS = 20
"""Lives of the child, one after the other, that brought no result at all."""

KEPT_POLICIES = 8
"""More than a campaign can have open rounds at a time."""
TICK_MS = 100
HELLO_EVERY_S = 1.0

log = structlog.get_logger()


class Parent:
    """Holds leased episodes, feeds them to a child, and keeps results until the hub has them.

    Args:
        address: of the hub, as `tcp://host:port`.
        name: how the worker is called in lists and logs.
        episode_limit_s: wall time after which a running episode is given up and its child killed.
    """

    def __init__(self, address: str, name: str, episode_limit_s: float = 60.0) -> None:
        self._link = Link(address)
        self._hello = Hello(PROTOCOL, name, CREDIT, platform.node(), os.getpid())
        self._episode_limit_s = episode_limit_s
        self._waiting: deque[Held] = deque()
        self._outbox: dict[tuple[int, int], EpisodeResult] = {}
        self._setups: dict[int, EpisodeSetup] = {}
        self._policies: dict[int, dict[int, Policy]] = {}
        self._false_starts = 0
        self._deaths: dict[tuple[int, int], int] = {}
        self._child = ChildProcess()
        self._heartbeat_s = 0.0
        self._next_beat_s = 0.0
        self._leaving = False
        self._handlers: dict[type, Callable[..., None]] = {
            Welcome: self._welcome,
            Refusal: self._refused,
            Setup: self._set_up,
            PolicyUpdate: self._learn,
            Lease: self._lease,
            Ack: self._forget,
            Drop: self._drop,
            Goodbye: self._leave,
        }

    def serve(self) -> None:
        """Work until the hub says goodbye or `leave` is called."""
        try:
            while not self._leaving:
                self.turn(child_spoke=self._wait())
        finally:
            self._link.send(Goodbye("stopped"))
            self._child.end()
            self._link.close()

    def turn(self, child_spoke: bool) -> None:
        """Do what is to be done now; never waits."""
        self._hear_hub()
        self._hear_child(child_spoke)
        self._feed_child()
        self._beat()

    def leave(self) -> None:
        """Stop after the current turn of the loop; safe to call from a signal handler."""
        self._leaving = True

    def _wait(self) -> bool:
        """For a word of the hub or of the child, but not for long; whether the child spoke."""
        poller = zmq.Poller()
        poller.register(self._link.socket, zmq.POLLIN)
        poller.register(self._child.descriptor, zmq.POLLIN)
        return self._child.descriptor in dict(poller.poll(TICK_MS))

    def _hear_hub(self) -> None:
        for message in self._link.receive():
            self._handlers[type(message)](message)

    def _welcome(self, message: Welcome) -> None:
        if self._heartbeat_s:
            return  # one for each hello that waited for the hub to come up
        log.info("welcomed", worker=self._hello.worker, hub=self._link.address)
        self._heartbeat_s = message.heartbeat_s
        for (campaign, _), result in self._outbox.items():
            self._link.send(Results(campaign, (result,)))

    def _refused(self, message: Refusal) -> None:
        """The hub does not know us (it was restarted, or we were given up): introduce again."""
        log.info("refused", worker=self._hello.worker, reason=message.reason)
        self._heartbeat_s = 0.0

    def _set_up(self, message: Setup) -> None:
        self._setups[message.campaign] = message.setup

    def _learn(self, message: PolicyUpdate) -> None:
        versions = self._policies.setdefault(message.campaign, {})
        versions[message.policy.version] = message.policy
        for old in sorted(versions)[:-KEPT_POLICIES]:
            del versions[old]

    def _lease(self, message: Lease) -> None:
        held = (*self._waiting, *self._child.running)
        mine = {(each.campaign, each.task.index) for each in held if each.wanted}
        for task in message.tasks:
            key = (message.campaign, task.index)
            if key in self._outbox:
                self._link.send(Results(message.campaign, (self._outbox[key],)))
            elif key not in mine:
                self._waiting.append(Held(message.campaign, task))

    def _forget(self, message: Ack) -> None:
        for index in message.indices:
            self._outbox.pop((message.campaign, index), None)

    def _drop(self, message: Drop) -> None:
        self._waiting = deque(held for held in self._waiting if held.campaign != message.campaign)
        self._setups.pop(message.campaign, None)
        self._policies.pop(message.campaign, None)
        self._child.drop(message.campaign)

    def _leave(self, _message: HubMessage) -> None:
        self._leaving = True

    def _hear_child(self, spoke: bool) -> None:
        alive = self._listen() if spoke else True
        if not alive:
            self._replace_child("killed its process", 1 if self._child.began else 0)
        elif self._child.overdue(self._episode_limit_s):
            self._replace_child(f"took longer than {self._episode_limit_s:g} s", MAX_CHILD_DEATHS)

    def _listen(self) -> bool:
        """Report what the child has finished; whether it lives."""
        alive, results = self._child.listen()
        for campaign, result in results:
            self._false_starts = 0
            self._report(campaign, result)
        return alive

    def _report(self, campaign: int, result: EpisodeResult) -> None:
        self._outbox[campaign, result.index] = result
        self._link.send(Results(campaign, (result,)))

    def _replace_child(self, what: str, weight: int) -> None:
        """Start a new child; the episode that was running is tried again, but not for ever."""
        status, held = self._child.end(), list(self._child.running)
        self._false_starts += 1
        if self._false_starts > MAX_FALSE_STARTS:
            weight = MAX_CHILD_DEATHS
        self._child = ChildProcess()
        self._waiting.extendleft(again for again in reversed(held[1:]) if self._can_run(again))
        log.warning("child replaced", worker=self._hello.worker, status=status, why=what)
        if held and self._can_run(held[0]):
            self._blame(held[0], f"The episode {what} (exit status {status}).", weight)

    def _can_run(self, held: Held) -> bool:
        """Whether its campaign was not dropped meanwhile, and all that it needs is here."""
        source, policies = held.task.source, self._policies.get(held.campaign, {})
        prepared = not isinstance(source, PolicySource) or source.version in policies
        return held.wanted and held.campaign in self._setups and prepared

    def _blame(self, held: Held, message: str, weight: int) -> None:
        """Count a death against an episode; one that had not begun when it happened weighs 0."""
        key = (held.campaign, held.task.index)
        self._deaths[key] = self._deaths.get(key, 0) + weight
        if self._deaths[key] < MAX_CHILD_DEATHS:
            self._waiting.appendleft(held)
            return
        del self._deaths[key]
        remedy = "Replay it alone with `eigenfail episode replay` to see where it stays or dies."
        fault = EpisodeFault("infrastructure", f"{message} {remedy}")
        self._report(held.campaign, unrunnable(held.task, fault))

    def _feed_child(self) -> None:
        while self._waiting and self._child.has_room:
            held = self._waiting.popleft()
            if not self._can_run(held):  # what it needs went astray: the hub begins with us anew
                self._heartbeat_s = 0.0
                continue
            self._prepare(held)
            self._child.run(held)

    def _prepare(self, held: Held) -> None:
        """Tell the child, once, what this episode needs: its campaign's setup, its policy."""
        self._child.set_up(held.campaign, self._setups[held.campaign])
        if isinstance(held.task.source, PolicySource):
            policies = self._policies[held.campaign]
            self._child.learn(held.campaign, policies[held.task.source.version])

    def _beat(self) -> None:
        now = time.monotonic()
        if now < self._next_beat_s:
            return
        if not self._heartbeat_s:
            self._link.send(self._hello)
            self._next_beat_s = now + HELLO_EVERY_S
            return
        held = self._child.running[0] if self._child.running else None
        running = (held.campaign, held.task.index) if held else (None, None)
        self._link.send(Heartbeat(*running))
        self._next_beat_s = now + self._heartbeat_s
