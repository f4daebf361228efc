"""Many workers in one process: each has a connection of its own, and speaks as real ones do.

What they bring is one real episode's result, over and over, with index and seed of what was asked
for, and with a robustness made of the seed, or of the noise where a probability of failure is
given. An episode is no work for them: they sleep for its duration, and report it. `python -m
benchmarks.speed.simulated_workers HUB WORKERS EPISODE_S [--probability P] [--tail S]` runs until it
is ended.
"""

import argparse
import contextlib
import os
import random
import time
from collections import deque
from collections.abc import Callable
from math import exp, inf, sqrt
from statistics import NormalDist
from typing import Any, NoReturn

import numpy as np
import zmq
from benchmarks.episode_loop import tasks
from msgspec.structs import replace

from eigenfail import plugins
from eigenfail.processes import die_with_parent
from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail.values.episode import EpisodeResult, EpisodeTask, Outcome, TrajectorySource
from eigenfail.values.learning import STATE
from eigenfail.versions import versions
from eigenfail.wire.messages import (
    PROTOCOL,
    Assembler,
    Drop,
    Heartbeat,
    Hello,
    Lease,
    Message,
    Piece,
    Refusal,
    Results,
    Welcome,
    encode,
    read_hub_message,
    split,
)

CREDIT = 256
HELLO_EVERY_S = 1.0
LOOK_EVERY_S = 0.002
SCENE_EVERY = 50
SEED = 5

Held = tuple[int, EpisodeTask]
Run = Callable[[EpisodeTask], EpisodeResult]
Duration = Callable[[EpisodeTask], float]
"""How long an episode takes. [s]"""


def examples() -> tuple[EpisodeResult, EpisodeResult]:
    """A result as most are, and one with its scene; both with what an adversary saw."""
    spec = CampaignSpec(name="crowd", method="monte_carlo", episodes=SCENE_EVERY + 2, seed=SEED)
    engine = plugins.load(plugins.ENGINES, "default")(spec.setup())
    with_scene, plain = engine.run(tasks(0, 2, SEED))
    states = np.full((plain.steps, len(STATE)), 0.5, np.float32)
    return replace(plain, states=states), replace(with_scene, states=states)


class Worker:
    """One of them: one connection, one episode at a time."""

    def __init__(self, number: int, address: str, duration_s: Duration) -> None:
        self.socket: zmq.Socket[bytes] = zmq.Context.instance().socket(zmq.DEALER)
        self.socket.setsockopt(zmq.LINGER, 0)
        self.socket.connect(address)
        self.due_s = 0.0
        self._duration_s = duration_s
        life = f"{os.getpid()}-{number}"
        self._hello = Hello(PROTOCOL, f"crowd-{number}", CREDIT, life=life, versions=versions())
        self._held: deque[Held] = deque()
        self._heartbeat_s = 0.0
        self._next_beat_s = 0.0
        self._ends_s = inf
        self._assembler = Assembler()
        self._handlers: dict[type[Message], Callable[[Any], None]] = {
            Welcome: self._welcome,
            Refusal: self._refused,
            Lease: self._lease,
            Drop: self._drop,
        }

    def hear(self) -> None:
        """Take what the hub said."""
        with contextlib.suppress(zmq.Again):
            while True:
                message = read_hub_message(self.socket.recv(zmq.NOBLOCK))
                if isinstance(message, Piece) and (whole := self._assembler.add(message)):
                    message = read_hub_message(whole)
                self._handlers.get(type(message), nothing)(message)

    def act(self, now_s: float, run: Run) -> None:
        """Do what is due: end episodes, begin others, be heard; `due_s` is when there is more."""
        while self._held and now_s >= self._ends_s:
            campaign, task = self._held.popleft()
            result = run(task)
            result = replace(result, wall_s=max(result.wall_s, self._duration_s(task)))
            for frame in split(Results(campaign, (result,))):
                self.socket.send(frame)
            self._begin(self._ends_s)
        if now_s >= self._next_beat_s:
            self._beat(now_s)
        self.due_s = min(self._ends_s, self._next_beat_s)

    def _begin(self, at_s: float) -> None:
        self._ends_s = at_s + self._duration_s(self._held[0][1]) if self._held else inf

    def _beat(self, now_s: float) -> None:
        if not self._heartbeat_s:
            self.socket.send(encode(self._hello))
            self._next_beat_s = now_s + HELLO_EVERY_S
            return
        held = tuple((campaign, task.index) for campaign, task in self._held)
        running = held[0] if held else (None, None)
        self.socket.send(encode(Heartbeat(*running, held)))
        self._next_beat_s = now_s + self._heartbeat_s

    def _welcome(self, message: Welcome) -> None:
        self._heartbeat_s = message.heartbeat_s
        # Real ones do not all come at the same moment.
        self._next_beat_s = time.monotonic() + self._heartbeat_s * random.random()

    def _refused(self, _message: Refusal) -> None:
        self._heartbeat_s = 0.0

    def _lease(self, message: Lease) -> None:
        was_idle = not self._held
        self._held.extend((message.campaign, task) for task in message.tasks)
        if was_idle:
            self._begin(time.monotonic())
        self.due_s = 0.0

    def _drop(self, message: Drop) -> None:
        self._held = deque(held for held in self._held if held[0] != message.campaign)
        self._begin(time.monotonic())


def by_seed() -> Run:
    """Runs episodes whose robustness is made of their seed."""
    plain, with_scene = examples()

    def run(task: EpisodeTask) -> EpisodeResult:
        shown = plain if task.index % SCENE_EVERY else with_scene
        measures = replace(shown.measures, robustness_m=0.5 + task.seed % 1_000 / 100.0)
        kind, seed = task.source_kind, task.seed
        return replace(shown, index=task.index, seed=seed, source=kind, measures=measures)

    return run


def beyond_plane(probability: float) -> Run:
    """Runs episodes that fail where their noise lies beyond a plane, as far as it has this P."""
    reach, of_seed = -NormalDist().inv_cdf(probability), by_seed()

    def run(task: EpisodeTask) -> EpisodeResult:
        assert isinstance(task.source, TrajectorySource)
        z, result = task.source.z, of_seed(task)
        left = reach - float(z.sum()) / sqrt(z.size)
        measures = replace(result.measures, robustness_m=max(left, 0.0))
        outcome = Outcome.SAFE if left > 0.0 else Outcome.COLLISION
        return replace(result, outcome=outcome, measures=measures)

    return run


def constant(episode_s: float) -> Duration:
    """All episodes take as long."""
    return lambda _task: episode_s


def log_normal(mean_s: float, tail: float) -> Duration:
    """The durations of episodes are log-normal, and made of their seeds.

    Args:
        mean_s: their mean. [s]
        tail: standard deviation of their logarithm.
    """
    return lambda task: mean_s * exp(tail * random.Random(task.seed).gauss() - tail**2 / 2)


def nothing(_message: Message) -> None:
    """Setups and policies are of no use here, and what was acknowledged is forgotten already."""


def serve(workers: list[Worker], run: Run) -> NoReturn:
    """Turn after turn."""
    poller = zmq.Poller()
    by_socket = {worker.socket: worker for worker in workers}
    for socket in by_socket:
        poller.register(socket, zmq.POLLIN)
    while True:
        for socket, _ in poller.poll(0):
            by_socket[socket].hear()
        now_s = time.monotonic()
        for worker in workers:
            if worker.due_s <= now_s:
                worker.act(now_s, run)
        time.sleep(LOOK_EVERY_S)


def main() -> None:
    """Come to the hub, and stay."""
    die_with_parent()
    parser = argparse.ArgumentParser()
    parser.add_argument("hub")
    parser.add_argument("workers", type=int)
    parser.add_argument("episode_s", type=float)
    parser.add_argument("--probability", type=float, help="of a failure, by the noise")
    parser.add_argument("--tail", type=float, help="standard deviation of log durations")
    told = parser.parse_args()
    run = by_seed() if told.probability is None else beyond_plane(told.probability)
    duration = log_normal(told.episode_s, told.tail) if told.tail else constant(told.episode_s)
    zmq.Context.instance().set(zmq.MAX_SOCKETS, told.workers + 8)
    serve([Worker(number, told.hub, duration) for number in range(told.workers)], run)


if __name__ == "__main__":
    main()
