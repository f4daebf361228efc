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
from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail.values.episode import EpisodeResult, EpisodeSetup, EpisodeTask, TrajectorySource
from eigenfail.values.measures import Measures
from eigenfail_workers.accounts import RecordedStep, RecordingPlanner
from eigenfail_workers.engine import Engine

T = TypeVar("T")

BATCH = 20


class EpisodeRecord(msgspec.Struct, frozen=True):
    """An episode as figures need it; `lost_tracks` counts the tracks that the planner gave up."""

    is_failure: bool
    measures: Measures
    lost_tracks: float


class EpisodePool:
    """Processes, one for each core, that keep their engines from call to call."""

    def __init__(self, pool: ProcessPoolExecutor) -> None:
        self._pool = pool

    def play(self, setup: EpisodeSetup, tasks: Sequence[EpisodeTask]) -> list[EpisodeRecord]:
        """Run the tasks, and return their records in the same order."""
        batches = [tasks[first : first + BATCH] for first in range(0, len(tasks), BATCH)]
        return list(chain.from_iterable(self._pool.map(play, repeat(setup), batches)))

    def each(self, function: Callable[..., T], *arguments: Iterable[Any]) -> list[T]:
        """Call a function with each set of arguments, side by side."""
        return list(self._pool.map(function, *arguments))

    def inject(self, setup: EpisodeSetup, z: NDArray[np.floating]) -> list[EpisodeRecord]:
        """Run an episode for each noise trajectory z, shape (n, steps, 2)."""
        sources = map(TrajectorySource, z.astype(np.float32))
        return self.play(setup, [EpisodeTask(i, 0, source) for i, source in enumerate(sources)])


@contextmanager
def open_pool() -> Iterator[EpisodePool]:
    """Open a pool of processes for the block."""
    os.environ.update(NUMERIC_ENVIRONMENT)
    with ProcessPoolExecutor(os.cpu_count(), get_context("spawn"), die_with_parent) as pool:
        yield EpisodePool(pool)


def play(setup: EpisodeSetup, tasks: Sequence[EpisodeTask]) -> list[EpisodeRecord]:
    """Run tasks in this process, and return their records."""
    engine, recorded = make_recording_engine(msgspec.json.encode(setup))
    return [make_record(result, recorded) for result in engine.run(tasks)]


@cache
def make_recording_engine(setup: bytes) -> tuple[Engine, list[RecordedStep]]:
    """Return an engine for a setup in JSON, and the steps that its planner records."""
    recorded: list[RecordedStep] = []
    decoded = msgspec.json.decode(setup, type=EpisodeSetup)
    return Engine(decoded, lambda planner: RecordingPlanner(planner, recorded)), recorded


def make_record(result: EpisodeResult, recorded: list[RecordedStep]) -> EpisodeRecord:
    """Return the part of a result that figures rest on."""
    if result.measures is None:
        raise EpisodeError(f"Episode {result.index} of seed {result.seed} failed: {result.fault}.")
    _, _, account, *_ = recorded[-1]
    return EpisodeRecord(result.is_failure, result.measures, float(account.get("lost_tracks", 0.0)))


def make_setup(scenario: str, planner: str, **parameters: float) -> EpisodeSetup:
    """Return the setup of a campaign with default values for everything else."""
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
    """Return the largest number of steps of an episode of a scenario."""
    plugin = plugins.load(plugins.SCENARIOS, scenario)
    return int(plugin()(plugin.Parameters(), 0).steps)
