"""Figure: P(failure) of a planner by a campaign of `splitting`."""

from collections.abc import Iterator, Sequence
from functools import cache
from itertools import chain
from typing import Any

import msgspec
import numpy as np
from benchmarks.episode_pool import BATCH, EpisodePool, horizon, make_setup
from benchmarks.figures import Figure
from benchmarks.samples import COMMAND

from eigenfail.values.episode import EpisodeResult, EpisodeSetup, EpisodeTask, learner_seed
from eigenfail.values.estimates import Estimate
from eigenfail.values.learning import LearnerContext
from eigenfail_services.campaigns.rounds import Rounds, run_in_process
from eigenfail_services.methods.splitting import MultilevelSplitting, SplittingSettings
from eigenfail_workers.engine import Engine

BUDGET = 72_000


class PoolEngine:
    """Runs the episodes of a campaign in all processes of a pool."""

    def __init__(self, pool: EpisodePool, setup: EpisodeSetup) -> None:
        self._crew = pool
        self._setup = setup

    def add_policy(self, _policy: object) -> None:
        """There is no policy."""

    def run(self, tasks: Sequence[EpisodeTask]) -> Iterator[EpisodeResult]:
        """Yield the results in the order of the tasks."""
        batches = [tasks[first : first + BATCH] for first in range(0, len(tasks), BATCH)]
        setups = [msgspec.json.encode(self._setup)] * len(batches)
        return chain.from_iterable(self._crew.each(run_batch, setups, batches))

    def close(self) -> None:
        """Nothing is held."""


def run_batch(setup: bytes, tasks: Sequence[EpisodeTask]) -> list[EpisodeResult]:
    """Run tasks in this process."""
    return list(make_engine(setup).run(tasks))


@cache
def make_engine(setup: bytes) -> Engine:
    """Return the engine of a setup in JSON."""
    return Engine(msgspec.json.decode(setup, type=EpisodeSetup))


def run_campaign(scenario: str, pool: EpisodePool, seed: int, budget: int = BUDGET) -> Estimate:
    """Return the estimate of a whole campaign of `splitting`."""
    nothing = np.zeros((0, horizon(scenario), 2), np.float32)
    context = LearnerContext(learner_seed(seed), budget, horizon(scenario), nothing)
    rounds = Rounds(MultilevelSplitting(context, SplittingSettings()), seed, budget)
    engine: Any = PoolEngine(pool, make_setup(scenario, "rulebook"))
    for _ in run_in_process(rounds, engine):
        pass
    estimate = rounds.estimate()
    if estimate is None:
        raise RuntimeError("splitting gives no estimate at the end")
    return estimate


def find(pool: EpisodePool, seed: int) -> Iterator[tuple[str, Figure]]:
    """Yield P(failure) at the defaults of `cut_in`."""
    found = run_campaign("cut_in", pool, seed)
    ends = found.interval and (found.interval.low, found.interval.high)
    stated = "none" if found.cv is None else f"{found.cv:.2f}"
    yield (
        "cut_in.p_fail",
        Figure(
            value=found.probability,
            unit="probability",
            n=found.episodes,
            interval=ends,
            note=f"splitting; coefficient of variation stated: {stated}. {found.problem}".strip(),
            command=COMMAND,
        ),
    )
