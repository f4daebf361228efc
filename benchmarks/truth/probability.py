"""Figure: the failure probability of a planner by subset simulation."""

from collections.abc import Iterator

import numpy as np
from benchmarks.episode_pool import EpisodePool, horizon, make_setup
from benchmarks.figures import Figure
from benchmarks.samples import COMMAND

from eigenfail.values.disturbance import AXES
from eigenfail_services.statistics.batches import Array
from eigenfail_services.statistics.pooled_estimate import pool_simulations
from eigenfail_services.statistics.subset_simulation import (
    SubsetSettings,
    SubsetSimulation,
    simulate_subsets,
)

CALLS = 46_000


def p_fail(scenario: str, pool: EpisodePool, seed: int) -> Iterator[tuple[str, Figure]]:
    """P(failure) of `rulebook` at a scenario's defaults."""
    simulation = simulate(scenario, pool, seed)
    results = [run.result for run in simulation.runs if run.result is not None]
    found = pool_simulations(results, simulation.trajectories_run)
    ends = found.interval and (found.interval.low, found.interval.high)
    yield (
        f"{scenario}.rulebook.p_fail",
        Figure(
            value=found.probability,
            unit="probability",
            n=found.episodes,
            interval=ends,
            note=story(simulation),
            command=COMMAND,
        ),
    )


def simulate(scenario: str, pool: EpisodePool, seed: int) -> SubsetSimulation:
    """A subset simulation whose trajectories are run as episodes."""
    setup = make_setup(scenario, "rulebook")

    def robustness(z: Array) -> Array:
        return np.array([one.measures.robustness_m for one in pool.inject(setup, z)])

    shape = horizon(scenario), len(AXES)
    return simulate_subsets(robustness, shape, CALLS, SubsetSettings(), seed)


def story(simulation: SubsetSimulation) -> str:
    """How the estimate came about."""
    levels = ", ".join(f"{one.threshold:.3g}" for one in simulation.first.levels)
    runs = [run.result for run in simulation.runs if run.result is not None]
    found = ", ".join(f"{one.probability or 0.0:.2g}" for one in runs)
    first_draws = ", ".join(str(one.distinct_first_draws) for one in runs)
    draws = " and ".join(str(one.draws) for one in runs)
    return (
        f"subset simulation, levels at {levels} m; {len(runs)} runs of {draws} samples on a level: "
        f"{found}, from {first_draws} first draws"
    )
