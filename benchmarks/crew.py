"""Episodes in a process for each core, with nothing of the service around them.

An episode comes out as in a campaign of the same seed: it depends on nothing but its task.
"""

import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from functools import cache
from itertools import chain, repeat
from multiprocessing import get_context
from typing import Any, TypeVar

import msgspec
import numpy as np
from numpy.typing import NDArray

from eigenfail import plugins
from eigenfail.errors import EpisodeError
from eigenfail.processes import NUMERIC_ENVIRONMENT, die_with_parent
from eigenfail.values import (
    CampaignSpec,
    EpisodeResult,
    EpisodeSetup,
    EpisodeTask,
    Measures,
    TrajectorySource,
)
from eigenfail_workers.accounts import RecordedStep, RecordingPlanner
from eigenfail_workers.engine import Engine

T = TypeVar("T")

BATCH = 20


class Played(msgspec.Struct, frozen=True):
    """What is kept of an episode; `lost_tracks` are those that the planner says it gave up."""

    is_failure: bool
    measures: Measures
    lost_tracks: float


class Crew:
    """The processes; each keeps its engines from call to call."""

    def __init__(self, pool: ProcessPoolExecutor) -> None:
        self._pool = pool

    def play(self, setup: EpisodeSetup, tasks: Sequence[EpisodeTask]) -> list[Played]:
        """Run the tasks; what came of them, in their order."""
        batches = [tasks[first : first + BATCH] for first in range(0, len(tasks), BATCH)]
        return list(chain.from_iterable(self._pool.map(play, repeat(setup), batches)))

    def each(self, function: Callable[..., T], *arguments: Iterable[Any]) -> list[T]:
        """Call a function with each set of arguments, side by side."""
        return list(self._pool.map(function, *arguments))

    def inject(self, setup: EpisodeSetup, z: NDArray[np.floating]) -> list[Played]:
        """Run an episode for each noise trajectory z, shape (n, steps, 2)."""
        sources = map(TrajectorySource, z.astype(np.float32))
        return self.play(setup, [EpisodeTask(i, 0, source) for i, source in enumerate(sources)])


@contextmanager
def crew() -> Iterator[Crew]:
    """A crew for as long as the block lasts."""
    os.environ.update(NUMERIC_ENVIRONMENT)
    with ProcessPoolExecutor(os.cpu_count(), get_context("spawn"), die_with_parent) as pool:
        yield Crew(pool)


def play(setup: EpisodeSetup, tasks: Sequence[EpisodeTask]) -> list[Played]:
    """Run tasks in this process."""
    engine, told = watched_engine(msgspec.json.encode(setup))
    return [kept(result, told) for result in engine.run(tasks)]


@cache
def watched_engine(setup: bytes) -> tuple[Engine, list[RecordedStep]]:
    """An engine for a setup in JSON, and what its planner tells of the last episode."""
    told: list[RecordedStep] = []
    decoded = msgspec.json.decode(setup, type=EpisodeSetup)
    return Engine(decoded, lambda planner: RecordingPlanner(planner, told)), told


def kept(result: EpisodeResult, told: list[RecordedStep]) -> Played:
    """The part of a result that figures rest on."""
    if result.measures is None:
        raise EpisodeError(f"Episode {result.index} of seed {result.seed} failed: {result.fault}.")
    _, _, account, *_ = told[-1]
    return Played(result.is_failure, result.measures, float(account.get("lost_tracks", 0.0)))


def staged(scenario: str, planner: str, **parameters: float) -> EpisodeSetup:
    """The setup of a campaign that leaves everything else as it is by default."""
    spec = CampaignSpec(
        name=scenario,
        method="monte_carlo",
        episodes=1,
        scenario=scenario,
        scenario_parameters=parameters,
        planner=planner,
    )
    return spec.setup()


def horizon(scenario: str) -> int:
    """How many steps an episode of a scenario has at most."""
    plugin = plugins.load(plugins.SCENARIOS, scenario)
    return int(plugin()(plugin.Parameters(), 0).steps)
