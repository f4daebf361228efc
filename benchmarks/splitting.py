"""Figures: P(failure) of a planner by campaigns of `splitting`, and how much they differ.

One campaign is run; ten of them are 500,000 episodes. The differences between campaigns are those
of 30 that were run once, by the method of this project on a compiled port of `cut_in` and
`rulebook`: their results are in `splitting_campaigns.json`.
"""

from collections.abc import Iterator, Sequence
from functools import cache
from itertools import chain
from pathlib import Path
from statistics import fmean, median, stdev
from typing import Any

import msgspec
import numpy as np
from episode_pool import BATCH, EpisodePool, horizon, make_setup
from figures import Figure
from samples import COMMAND

from eigenfail.values import (
    EpisodeResult,
    EpisodeSetup,
    EpisodeTask,
    Estimate,
    LearnerContext,
    learner_seed,
)
from eigenfail_services.campaigns.rounds import Rounds, run_in_process
from eigenfail_services.methods.splitting import MultilevelSplitting, SplittingSettings
from eigenfail_workers.engine import Engine

BUDGET = 72_000
STORED = Path(__file__).with_name("splitting_campaigns.json")
PORT = (
    "30 campaigns of seeds 300 to 329, run once on a compiled port of the scenario and the planner "
    "that is not part of the project, with the braking that a vehicle straight ahead requires as "
    "importance"
)


class StoredCampaign(msgspec.Struct, frozen=True):
    """What a campaign on the port estimated.

    Attributes:
        cv: coefficient of variation that it stated.
        low: lower end of its 95 % interval.
        high: upper end.
    """

    seed: int
    episodes: int
    probability: float
    cv: float
    low: float
    high: float


def read_stored() -> tuple[StoredCampaign, ...]:
    """Return the campaigns on the port."""
    return msgspec.json.decode(STORED.read_bytes(), type=tuple[StoredCampaign, ...])


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


def run_campaign(scenario: str, pool: EpisodePool, seed: int) -> Estimate:
    """Return the estimate of a whole campaign of `splitting`."""
    nothing = np.zeros((0, horizon(scenario), 2), np.float32)
    context = LearnerContext(learner_seed(seed), BUDGET, horizon(scenario), nothing)
    rounds = Rounds(MultilevelSplitting(context, SplittingSettings()), seed, BUDGET)
    engine: Any = PoolEngine(pool, make_setup(scenario, "rulebook"))
    for _ in run_in_process(rounds, engine):
        pass
    estimate = rounds.estimate()
    if estimate is None or estimate.probability is None:
        raise RuntimeError(f"splitting gives no number: {estimate}")
    return estimate


def find(pool: EpisodePool, seed: int) -> Iterator[tuple[str, Figure]]:
    """Yield P(failure) at the defaults of `cut_in`, and figures of campaigns on the port."""
    found = run_campaign("cut_in", pool, seed)
    ends = found.interval and (found.interval.low, found.interval.high)
    yield (
        "cut_in.p_fail",
        Figure(
            value=found.probability,
            unit="probability",
            n=found.episodes,
            interval=ends,
            note=f"splitting; coefficient of variation stated: {found.cv:.2f}; seed {seed}",
            command=COMMAND,
        ),
    )
    yield from compare_stored(read_stored())


def compare_stored(stored: Sequence[StoredCampaign]) -> Iterator[tuple[str, Figure]]:
    """Yield how much campaigns differ, what they state of it, and how often they hold the truth."""
    found = [one.probability for one in stored]
    between = stdev(found) / fmean(found)
    stated = median(one.cv for one in stored)
    calls = max(one.episodes for one in stored)

    def make(value: float, unit: str, note: str = PORT) -> Figure:
        return Figure(value=value, unit=unit, n=len(stored), note=note, command=COMMAND)

    yield "cut_in.p_fail.cv_between", make(between, "standard deviation / mean")
    yield "cut_in.p_fail.calls", make(calls, "episodes", f"the most of any; {PORT}")
    yield "cut_in.p_fail.stated_over_between", make(stated / between, "ratio", f"median; {PORT}")
    yield "cut_in.p_fail.mean", make(fmean(found), "probability")
