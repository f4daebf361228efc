"""Subset simulation: a small failure probability as a product of larger conditional ones."""

from collections.abc import Mapping, Sequence
from math import inf
from typing import Annotated

import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

from eigenfail.contracts import MethodTraits, ModeProbability
from eigenfail.errors import InvalidValue
from eigenfail.values import Estimate, LearnerContext
from eigenfail_services.methods.wave_learner import SimulationDriver, WaveLearner
from eigenfail_services.statistics.pooled_estimate import (
    estimate_unfinished,
    explain_missing_runs,
    pool_simulations,
    refuse_estimate,
)
from eigenfail_services.statistics.subset_simulation import (
    FEWEST_SAMPLES,
    PLANNED_LEVELS,
    Chains,
    LevelRun,
    SubsetEnd,
    SubsetEstimate,
    SubsetSettings,
    SubsetSimulation,
    estimate_from_failures,
    estimate_without_failures,
    make_level,
)


class SubsetMethodSettings(SubsetSettings, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Settings of `subset`."""

    round_size: Annotated[
        int, Meta(ge=1, le=100_000, description="episodes in a round at most")
    ] = 10_000

    def check_budget(self, episodes: int) -> None:
        """Raise InvalidValue if the budget allows too few samples, unless they were chosen."""
        fewest = self.count_fewest_trajectories()
        if self.samples is None and episodes < fewest:
            raise InvalidValue(
                "episodes",
                f"{episodes} are fewer than {FEWEST_SAMPLES} samples on each of {PLANNED_LEVELS} "
                f"levels in a pilot run and {self.runs} further runs, which take {fewest}.",
                "Give more episodes: with tens of thousands the estimate is good.",
            )


class SubsetMethod(WaveLearner[SubsetSimulation]):
    """Descends the levels of robustness to failures: a pilot run, then several independent runs.

    A wave of episodes is requested at a time: draws from p(x) on the first level, then a move
    of every chain of all runs.

    Raises:
        InvalidValue: the budget allows too few samples.
    """

    Settings = SubsetMethodSettings
    traits = MethodTraits(
        learns=False, mode_probability=ModeProbability.LEVELS, chart_mark=4, references={}
    )
    kind = "subset"

    def __init__(self, context: LearnerContext, settings: SubsetMethodSettings) -> None:
        settings.check_budget(context.episodes)
        self._settings = settings
        super().__init__(context, settings.round_size)

    def _make_simulation(self) -> SubsetSimulation:
        return start_simulation(self._context, self._settings)

    def estimate(self) -> Estimate | None:
        """Return the failure probability; before the end of all runs, a preliminary statement."""
        simulation = self._driver.simulation
        if not self._driver.is_done:
            return estimate_unfinished(simulation, self._is_spent)
        found = [one.result for one in simulation.runs if one.result is not None]
        if not found:
            return explain_missing_runs(simulation)
        return pool_simulations(found, simulation.runs[0].draws, simulation.trajectories_run)


def start_simulation(context: LearnerContext, settings: SubsetSettings) -> SubsetSimulation:
    """Return the simulation of a campaign, before its first wave."""
    return SubsetSimulation(context.horizon, context.episodes, settings, (context.seed,))


MIN_EFFECTIVE_FIRST_DRAWS = 5.0
"""Behind the failures of a mode; with fewer, both the mode and its share are due to chance."""

NO_MODE = -1


def estimate_modes(
    simulation: SubsetSimulation,
    robustness: Sequence[float],
    mode_of: Mapping[int, int],
    modes: int,
) -> tuple[Estimate, ...] | None:
    """Return the failure probability of each mode.

    P(mode) = P(robustness <= last threshold above 0) × share of the samples drawn below it that are
    failures of the mode.

    Args:
        simulation: simulation of the campaign before its first wave; it is run again.
        robustness: robustness of each episode in index order, 0 of a failure. [m]
        mode_of: mode of each failure, by the index of its episode.
        modes: number of modes.

    Returns:
        None unless all runs reached failures.
    """
    index_of = replay_waves(simulation, robustness)
    chains = [each.chains for each in simulation.runs]
    if not chains or any(each is None for each in chains):
        return None
    labels = [label_samples(each, index_of, mode_of) for each in chains if each is not None]
    return tuple(_estimate_mode(simulation, labels, mode) for mode in range(modes))


def replay_waves(simulation: SubsetSimulation, robustness: Sequence[float]) -> dict[bytes, int]:
    """Run a simulation again; return the index of each failure by its noise."""
    driver, index_of, count = SimulationDriver(simulation), dict[bytes, int](), 0
    while not driver.is_done and count + len(driver.wave) <= len(robustness):
        values = robustness[count : count + len(driver.wave)]
        failed = np.flatnonzero(np.array(values) <= 0.0).tolist()
        # The float64 values that the simulation made, as they are in its chains; the noise of
        # stored episodes was rounded to float32 and could not be found there.
        index_of |= {driver.wave[row].tobytes(): count + row for row in failed}
        count += len(values)
        driver.add_robustness(values)
    return index_of


def label_samples(
    chains: Chains, index_of: Mapping[bytes, int], mode_of: Mapping[int, int]
) -> NDArray[np.int64]:
    """Return the mode of each sample of a level, shape (length, chains); -1 for no failure."""
    modes = np.full(chains.values.shape, NO_MODE)
    for place in np.argwhere(chains.values <= 0.0).tolist():
        index = index_of[chains.z[tuple(place)].tobytes()]
        modes[tuple(place)] = mode_of.get(index, NO_MODE)
    return modes


def _estimate_mode(
    simulation: SubsetSimulation, labels: Sequence[NDArray[np.int64]], mode: int
) -> Estimate:
    """Return the estimate of one mode, or the reason why there is none."""
    estimates = [
        _restrict_to_mode(run, modes == mode)
        for run, modes in zip(simulation.runs, labels, strict=True)
    ]
    effective = sum(one.effective_first_draws for one in estimates)
    if effective < MIN_EFFECTIVE_FIRST_DRAWS:
        problem = (
            f"Its failures on the last level are worth {effective:.1f} independent first draws, and"
            f" it takes {MIN_EFFECTIVE_FIRST_DRAWS:.0f}. Give the campaign more episodes."
        )
        return refuse_estimate(simulation.trajectories_run, problem)
    return pool_simulations(estimates, simulation.runs[0].draws, simulation.trajectories_run)


def _restrict_to_mode(run: LevelRun, inside: NDArray[np.bool_]) -> SubsetEstimate:
    """Return a run's estimate as if only the samples in `inside` had failed.

    They get robustness 0, all others of the last level infinity; the levels before stay.

    Args:
        run: run over the levels.
        inside: mask of these samples, shape (length, chains).
    """
    trajectories_run = run.result.trajectories_run if run.result else 0
    if run.chains is None or not inside.any():
        return estimate_without_failures(run.levels, SubsetEnd.MISSED, trajectories_run)
    restricted = run.chains._replace(values=np.where(inside, 0.0, inf))
    levels = (*run.levels[:-1], make_level(restricted, 0.0))
    return estimate_from_failures(levels, restricted, run.draws, trajectories_run)
