"""Campaigns whose rounds are open in parallel, run on toy workers that take their time."""

from collections import deque
from collections.abc import Callable
from heapq import heappop, heappush
from typing import NamedTuple

import numpy as np

from eigenfail.settings import read_settings
from eigenfail.testing.learner import Corridor, ToyEngine
from eigenfail.values.campaign_spec import StopRules
from eigenfail.values.episode import EpisodeResult, EpisodeTask
from eigenfail.values.learning import LearnerContext
from eigenfail_services.campaigns.rounds import Rounds, run_in_process

STEPS = 5
CORRIDOR = Corridor(steps=STEPS, wall=0.6)
FAILING = np.random.default_rng(1).normal((3.0, 0.0), 0.3, (12, STEPS, 2)).astype(np.float32)


def make_rounds(kind, parallel, budget=200, rules=None, **settings) -> Rounds:
    context = LearnerContext(3, budget, STEPS, FAILING, parallel=parallel)
    learner = kind(context, read_settings(kind.Settings, settings, "settings"))
    return Rounds(learner, 3, budget, rules or StopRules())


Episode = tuple[int, bool, bytes]


def describe(result) -> Episode:
    return result.index, result.is_failure, result.noise.z.tobytes()


def run(rounds: Rounds) -> list[Episode]:
    return [describe(one) for one in run_in_process(rounds, ToyEngine(CORRIDOR))]


class Play(NamedTuple):
    """A campaign that was run: its episodes in index order, and the workers' idle time."""

    episodes: list[Episode]
    busy: float


def play(rounds: Rounds, workers: int, seconds: Callable[[], float] = lambda: 1.0) -> Play:
    """Run a campaign on workers that each take so long for an episode."""
    engine, waiting, seen = ToyEngine(CORRIDOR), deque[EpisodeTask](), -1
    running: list[tuple[float, int, EpisodeTask]] = []
    found: dict[int, EpisodeResult] = {}
    now = worked = 0.0
    while opened := rounds.open():
        for each in opened:
            if each.number > seen:
                waiting.extend(each.tasks)
                seen = each.number
        while any(task.index not in found for task in opened[0].tasks):
            while waiting and len(running) < workers:
                took = seconds()
                task = waiting.popleft()
                worked += took
                heappush(running, (now + took, task.index, task))
            now, index, task = heappop(running)
            (found[index],) = engine.run([task])
        rounds.complete([found[task.index] for task in opened[0].tasks])
    return Play([describe(found[index]) for index in sorted(found)], worked / (workers * now))
