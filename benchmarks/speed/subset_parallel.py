"""Figures of `subset` with `parallel`: how busy workers are, and how good its estimates are.

`find_busy` runs campaigns in the service, from the first episode to the last. The workers are made
up, and sleep for 1 s over an episode; it fails where its noise lies beyond a plane. Hub, learner
and database are real. Unlike the rates of `scale.py` these are of a whole campaign: chains wait at
the end of each level, and no span of it is like another. `find_estimates` compares estimates on the
known problems, where groups of chains share a step, with those of chains that all move together.
"""

from collections.abc import Iterator

import numpy as np
from benchmarks.episode_pool import EpisodePool
from benchmarks.figures import Figure
from benchmarks.samples import COMMAND
from benchmarks.speed.hub import playing, present, run_simulated_workers
from benchmarks.truth.intervals import Plan, Verdict, estimate, judge
from benchmarks.truth.known_problems import PROBLEMS
from sqlalchemy import text
from started import wait_until

from eigenfail.values.estimates import Estimate
from eigenfail_services.methods.subset import SubsetMethod

WORKERS, EPISODES, EPISODE_S = 100, 20_000, 1.0
PROBABILITY = 1e-4
"""Of failure; what subset simulation is for, and about that of `rulebook` on `cut_in`."""

PATIENCE_S = 1_200.0

SPAN_MS = text(
    "SELECT max(finished_ms) - min(finished_ms) FROM episodes WHERE campaign = :campaign"
)


def find_busy(_crew: EpisodePool, seed: int) -> Iterator[tuple[str, Figure]]:
    """Run a campaign with `parallel`, and one without."""
    yield "subset_busy_100", measure_busy(seed, WORKERS)
    yield "subset_busy_100_in_waves", measure_busy(seed, None)


def measure_busy(seed: int, parallel: int | None) -> Figure:
    """Return the share of the workers' time that is spent on episodes."""
    with playing() as stage:
        services = stage.services()
        with run_simulated_workers(services.hub, WORKERS, EPISODE_S, probability=PROBABILITY):
            wait_until(lambda: present(stage) == WORKERS, "all workers are there")
            campaign = stage.create(
                method="subset",
                episodes=EPISODES,
                seed=seed,
                parallel=parallel,
                simulator="highway",
                planner="rulebook",
            )
            wait_until(lambda: stage.is_over(campaign), "the campaign ends", PATIENCE_S)
        done, span_ms = stage.finished(campaign), stage.ask(SPAN_MS, {"campaign": campaign})
    share = done * EPISODE_S / (WORKERS * (span_ms / 1000.0 + EPISODE_S))
    note = f"{done} episodes of {EPISODE_S:g} s on {WORKERS} made-up workers"
    return Figure(value=share, unit="share of time", n=1, command=COMMAND, note=note)


SEEDS, CALLS, PARALLEL = 100, 2_000, 10
"""With 2,000 calls the first run has 22 chains, here in groups of four or five."""

PLANS = tuple(Plan(SubsetMethod, CALLS, {}, PROBLEMS, parallel=each) for each in (None, PARALLEL))


def find_estimates(pool: EpisodePool, seed: int) -> Iterator[tuple[str, Figure]]:
    """Compare the estimates with `parallel` with those without, on each problem."""
    pairs = [
        (judge_plan(0, problem, pool, seed), judge_plan(1, problem, pool, seed))
        for problem in range(len(PROBLEMS))
    ]
    judged = [(before, after) for before, after in pairs if before.is_judged and after.is_judged]
    ratios = np.array([after.error / before.error for before, after in judged])
    note = f"{SEEDS} campaigns of {CALLS} episodes on each of {len(judged)} problems"
    value = float(np.median(ratios))
    yield (
        "subset_parallel_error",
        Figure(
            value=value,
            unit="ratio of errors",
            n=len(judged),
            spread=(float(ratios.min()), float(ratios.max())),
            command=COMMAND,
            note=f"{note}, with parallel = {PARALLEL} ÷ without: median",
        ),
    )
    for name, place in (("subset_parallel_covered", 1), ("subset_parallel_covered_in_waves", 0)):
        told = sum(pair[place].told for pair in judged)
        held = sum(pair[place].told * pair[place].held for pair in judged)
        yield name, Figure(value=held / told, unit="share", n=SEEDS, command=COMMAND, note=note)


def judge_plan(plan: int, problem: int, pool: EpisodePool, seed: int) -> Verdict:
    """Run the campaigns of a plan on a problem."""
    found = pool.each(estimate_at, [plan] * SEEDS, [problem] * SEEDS, range(seed, seed + SEEDS))
    return judge(found, PROBLEMS[problem].probability)


def estimate_at(plan: int, problem: int, seed: int) -> Estimate:
    """Return the estimate of one campaign; functions do not go from process to process."""
    return estimate(PLANS[plan], PROBLEMS[problem], seed)
