"""Subset simulation: a small failure probability as a product of larger conditional ones."""

from collections.abc import Mapping, Sequence
from math import inf
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from eigenfail.contracts import MethodTraits, ModeProbability
from eigenfail.errors import InvalidValue
from eigenfail.values.estimates import Estimate
from eigenfail.values.learning import LearnerContext, RoundSizes
from eigenfail_services.methods import RoundSize, batch_learner
from eigenfail_services.statistics import pooled_estimate, subset_estimate, subset_simulation
from eigenfail_services.statistics.conditional_sampler import Chains

MOST_VALUES = 21_201
"""Values of noise of an episode: the most dimensions of a Sobol sequence in scipy."""


class SubsetMethodSettings(
    subset_simulation.SubsetSettings, frozen=True, forbid_unknown_fields=True, kw_only=True
):
    """Settings of `subset`."""

    round_size: RoundSize = 10_000

    def check_budget(self, episodes: int) -> None:
        """Raise InvalidValue if the budget allows too few samples and `samples` is not set."""
        fewest = self.count_fewest_trajectories()
        if self.samples is None and episodes < fewest:
            raise InvalidValue(
                "episodes",
                f"{episodes} are fewer than {subset_simulation.FEWEST_SAMPLES} samples on each of "
                f"{subset_simulation.PLANNED_LEVELS} levels in {self.runs} runs, which take "
                f"{fewest}.",
                "Give more episodes: with tens of thousands the estimate is good.",
            )


class SubsetMethod(batch_learner.BatchLearner[subset_simulation.SubsetSimulation]):
    """Descends levels of robustness to failures: one run chooses the levels, others repeat them.

    One wave of episodes is requested at a time: draws from p(x) on the first level, then a move of
    every chain of all runs. With `parallel`, chains move in groups that do not wait for each other.

    Raises:
        InvalidValue: the budget allows too few samples, or the noise has too many values.
    """

    Settings = SubsetMethodSettings
    traits = MethodTraits(
        tolerates_delay=True,
        bounds_probability=True,
        learns=False,
        mode_probability=ModeProbability.LEVELS,
        chart_mark=4,
        references={},
    )
    kind = "subset"

    def __init__(self, context: LearnerContext, settings: SubsetMethodSettings) -> None:
        settings.check_budget(context.episodes)
        batch_learner.check_values(
            "subset", MOST_VALUES, context, "Take method monte_carlo or cem."
        )
        self._settings = settings
        super().__init__(context, settings.round_size)

    @staticmethod
    def round_sizes(settings: SubsetMethodSettings, episodes: int) -> RoundSizes:
        """Return the maximum size of rounds, and the number of chains of the first run."""
        size = settings.round_size
        return RoundSizes(size, size, width=settings.count_chains(episodes))

    def _make_simulation(self) -> subset_simulation.SubsetSimulation:
        return start_simulation(self._context, self._settings)

    def estimate(self) -> Estimate | None:
        """Return the failure probability; before the end of all runs, a preliminary statement."""
        simulation = self._driver.simulation
        if not self._driver.is_done:
            return pooled_estimate.estimate_unfinished(simulation, self._is_spent)
        return pooled_estimate.estimate_ended(simulation)


def start_simulation(
    context: LearnerContext, settings: subset_simulation.SubsetSettings
) -> subset_simulation.SubsetSimulation:
    """Return the simulation of a campaign, before its first wave."""
    return subset_simulation.SubsetSimulation(
        (context.horizon, context.channels),
        context.episodes,
        settings,
        (context.seed,),
        context.parallel,
    )


MIN_EFFECTIVE_FIRST_DRAWS = 5.0
"""Behind the failures of a mode; with fewer, both the mode and its share are due to chance."""

NO_MODE = -1


class ReachedRun(NamedTuple):
    """Estimate of a run that reached failures, with the samples of its last level."""

    result: subset_estimate.SubsetEstimate
    chains: Chains


def estimate_modes(
    simulation: subset_simulation.SubsetSimulation,
    robustness: Sequence[float],
    mode_of: Mapping[int, int],
    modes: int,
) -> tuple[Estimate, ...] | None:
    """Return the failure probability of each mode.

    P(mode) = P(robustness <= last threshold above 0) × share of the samples below this threshold
    that are failures of the mode.

    Args:
        simulation: simulation of the campaign before its first wave; it is run again.
        robustness: robustness of each episode in index order, 0 for a failure. [m]
        mode_of: mode of each failure, by the index of its episode.
        modes: number of modes.

    Returns:
        None unless all runs reached failures.
    """
    index_of = replay_simulation(simulation, robustness)
    reached = [
        ReachedRun(run.result, run.chains) for run in simulation.runs if run.result and run.chains
    ]
    if not reached or len(reached) < len(simulation.runs):
        return None
    labels = [label_samples(each.chains, index_of, mode_of) for each in reached]
    by_mode = [
        [_restrict_to_mode(run, each == mode) for run, each in zip(reached, labels, strict=True)]
        for mode in range(modes)
    ]
    return tuple(_estimate_mode(each, simulation.trajectories_run) for each in by_mode)


def replay_simulation(
    simulation: subset_simulation.SubsetSimulation, robustness: Sequence[float]
) -> dict[bytes, int]:
    """Repeat a simulation, and return the index of each failure by the bytes of its noise."""
    driver, index_of, count = batch_learner.SimulationDriver(simulation), dict[bytes, int](), 0
    while not driver.is_done and count < len(robustness):
        z = driver.take_trajectories(len(robustness) - count)
        values = robustness[count : count + len(z)]
        failed = np.flatnonzero(np.array(values) <= 0.0).tolist()
        # The float64 values that the simulation made, as they are in its chains; the noise of
        # stored episodes was rounded to float32 and could not be found there.
        index_of |= {z[row].tobytes(): count + row for row in failed}
        count += len(values)
        driver.add_robustness(values)
    return index_of


def label_samples(
    chains: Chains, index_of: Mapping[bytes, int], mode_of: Mapping[int, int]
) -> NDArray[np.int64]:
    """Return the mode of each sample of a level, shape (length, chains); -1 without a failure."""
    modes = np.full(chains.values.shape, NO_MODE)
    for place in np.argwhere(chains.values <= 0.0).tolist():
        index = index_of[chains.z[tuple(place)].tobytes()]
        modes[tuple(place)] = mode_of.get(index, NO_MODE)
    return modes


def _estimate_mode(estimates: Sequence[subset_estimate.SubsetEstimate], episodes: int) -> Estimate:
    """Return the pooled estimate of one mode over the runs, or why it cannot be given."""
    effective = sum(one.effective_first_draws for one in estimates)
    if effective < MIN_EFFECTIVE_FIRST_DRAWS:
        problem = (
            f"Its failures on the last level are worth {effective:.1f} independent first draws, and"
            f" it takes {MIN_EFFECTIVE_FIRST_DRAWS:.0f}. Give the campaign more episodes."
        )
        return pooled_estimate.refuse_estimate(episodes, problem)
    return pooled_estimate.pool_simulations(estimates, episodes)


def _restrict_to_mode(run: ReachedRun, inside: NDArray[np.bool_]) -> subset_estimate.SubsetEstimate:
    """Return a run's estimate as if only the samples in `inside` had failed.

    These samples get robustness 0, and all others of the last level infinity. Earlier levels stay
    unchanged.

    Args:
        run: run that reached failures.
        inside: mask of the failing samples, shape (length, chains).
    """
    found = run.result
    restricted = run.chains._replace(values=np.where(inside, 0.0, inf))
    # The thresholds are those of all failures: only the share on the last level is a mode's.
    levels = (*found.levels[:-1], subset_estimate.make_level(restricted, 0.0))
    if not inside.any():
        return subset_estimate.estimate_without_failures(
            levels, subset_estimate.SubsetEnd.MISSED, found.draws, found.trajectories_run
        )
    return subset_estimate.estimate_from_failures(
        levels, restricted, found.draws, found.trajectories_run
    )
