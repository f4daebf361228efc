"""The probability of a rare failure by subset simulation (Au and Beck 2001).

P(r <= 0) = P(r <= b_1) · P(r <= b_2 | r <= b_1) · … with levels b_1 > b_2 > … of robustness r. Each
level is chosen so that a fixed share of the previous level's samples reaches it. Source:
Probabilistic Engineering Mechanics 16 (4), 263–277.

A trajectory is the noise z of one episode, shape (steps, channels). It is requested when a
simulation yields it in a batch. It was run when its robustness is sent back. If its episode
errored, NaN is sent, and the trajectory counts as not run. A sample is a trajectory that counts on
a level. If the move of a Markov chain is not accepted, two of its samples have the same trajectory.
So a level may have more samples than requested trajectories.

The first run chooses the levels from its own samples. Later runs repeat these levels with the rest
of the budget. Their levels are fixed before they begin. So the product of their shares is unbiased,
independently of the first run's results, and the lineages of their samples give its variance (Cérou
et al. 2012, Statistics and Computing 22, 795–808; Lee and Whiteley 2018, Biometrika 105, 609–625).
Levels that a run chooses from its own samples bias it a little, and hide a part of its error.
"""

from collections.abc import Generator, Sequence
from math import ceil, inf, prod, sqrt
from typing import Annotated, NamedTuple

import msgspec
import numpy as np
from msgspec import Meta

from eigenfail_services.statistics import (
    batches,
    conditional_sampler,
    gaussian_mixture,
    subset_estimate,
)

FEWEST_SAMPLES = 20
"""Samples on a level below which neither a level nor its probability is estimated."""

PLANNED_LEVELS = 7

FIRST_PART = 1.4
"""What the first run would take of the budget over the planned levels, in even parts of all runs,
of which there are two at least. It is more than one part since most failures take fewer levels. On
the known problems 1, 1.2 and 1.4 gave the same error; with 1.4 more of the first runs found their
way between many local minima."""


class SubsetSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Settings of a subset simulation, and of the method `subset`."""

    samples: Annotated[
        Annotated[int, Meta(ge=FEWEST_SAMPLES, le=100_000)] | None,
        Meta(
            description="samples on each level of a run at most; none given: what the budget allows"
        ),
    ] = None
    level_share: Annotated[
        float, Meta(ge=0.05, le=0.5, description="share of them that is to reach the next level")
    ] = 0.1
    acceptance: Annotated[
        float, Meta(ge=0.1, le=0.9, description="share of the moves that is to be accepted")
    ] = 0.4
    most_levels: Annotated[int, Meta(ge=1, le=100, description="levels at most")] = 20
    runs: Annotated[
        int, Meta(ge=1, le=10, description="independent runs, to be compared with each other")
    ] = 2

    def count_fewest_trajectories(self) -> int:
        """Return the smallest budget for `FEWEST_SAMPLES` samples on each planned level."""
        first = ceil(FEWEST_SAMPLES * self._count_trajectories_per_draw(PLANNED_LEVELS))
        return first + self.count_reserved(PLANNED_LEVELS)

    def count_reserved(self, levels: int) -> int:
        """Return the number of trajectories that later runs need for a number of levels."""
        return (self.runs - 1) * levels * FEWEST_SAMPLES

    def choose_first_draws(self, budget: int) -> int:
        """Return the number of first draws of the first run, for a budget of all runs."""
        part = FIRST_PART * budget / max(self.runs, 2)
        most = budget - self.count_reserved(PLANNED_LEVELS)
        return max(self.choose_draws(min(part, most), PLANNED_LEVELS), FEWEST_SAMPLES)

    def count_chains(self, budget: int) -> int:
        """Return the number of chains on each level of the first run, for a budget of all runs."""
        return ceil(self.level_share * self.choose_first_draws(budget))

    def choose_draws(self, trajectories: float, levels: int) -> int:
        """Return the number of first draws of a run, for its trajectories and number of levels."""
        affordable = int(trajectories / self._count_trajectories_per_draw(levels))
        return min(affordable, self.samples or affordable)

    def _count_trajectories_per_draw(self, levels: int) -> float:
        """Return the number of trajectories of a run per first draw; starts are not rerun."""
        return 1.0 + (levels - 1) * (1.0 - self.level_share)


class FirstRun:
    """A subset simulation that chooses its levels from its own samples.

    Every sample that reaches a level starts a chain.

    Attributes:
        draws: number of independent first draws.
        levels: levels found so far; the last level is 0 once failures were reached.
        chains: samples of the last level, once failures were reached; None before that.
        result: estimate, once failures were reached; None before that.

    Args:
        shape: steps and channels of the noise.
        max_trajectories: maximum number of requested trajectories of all runs.
        settings: settings of the simulation.
        sampler: sampler that only this run uses.
    """

    def __init__(
        self,
        shape: batches.NoiseShape,
        max_trajectories: int,
        settings: SubsetSettings,
        sampler: conditional_sampler.ConditionalSampler,
    ) -> None:
        self._shape = shape
        self._max_trajectories = max_trajectories
        self._settings = settings
        self._sampler = sampler
        self.draws = settings.choose_first_draws(max_trajectories)
        self.levels: list[subset_estimate.SubsetLevel] = []
        self.chains: conditional_sampler.Chains | None = None
        self.result: subset_estimate.SubsetEstimate | None = None

    def run(self) -> Generator[batches.Batches, batches.Array, subset_estimate.SubsetEnd]:
        """Descend the levels. Call this once."""
        settings, sampler = self._settings, self._sampler
        chains = yield from sampler.draw_independent(self.draws, self._shape)
        threshold = _find_next_threshold(chains.values, inf, settings.level_share)
        while threshold is not None and len(self.levels) < settings.most_levels:
            self.levels.append(subset_estimate.make_level(chains, threshold))
            if threshold <= 0.0:
                self.chains = chains
                self.result = subset_estimate.estimate_from_failures(
                    self.levels, chains, self.draws, sampler.trajectories_run
                )
                return subset_estimate.SubsetEnd.REACHED
            starts = conditional_sampler.find_starts(chains, threshold)
            moves = ceil(self.draws / len(starts)) - 1
            # A level that cannot be finished is not begun, so that plain draws get all that is
            # left.
            if moves * len(starts) > self._count_free():
                return subset_estimate.SubsetEnd.CUT
            chains = yield from sampler.move_chains(chains, threshold, starts, moves)
            threshold = _find_next_threshold(chains.values, threshold, settings.level_share)
        return (
            subset_estimate.SubsetEnd.STALLED
            if threshold is None
            else subset_estimate.SubsetEnd.SPENT
        )

    def _count_free(self) -> int:
        """Return the number of trajectories left for a level, minus the reserve of later runs."""
        reserved = self._settings.count_reserved(len(self.levels) + 1)
        return self._max_trajectories - self._sampler.trajectories_requested - reserved


class LevelRun:
    """An estimate of P(robustness <= 0) over given levels, with a given number of trajectories.

    Every sample that reaches a level starts a chain. Each level except the last has as many samples
    as there are first draws. The last level uses the remaining trajectories.

    Attributes:
        levels: levels passed so far.
        chains: samples of the last level, once failures were reached; None before that.
        draws: number of independent first draws.
        max_trajectories: maximum number of trajectories that the run requests.
        result: estimate, after the end.

    Args:
        shape: steps and channels of the noise.
        thresholds: decreasing levels; the last level is 0. [m]
        max_trajectories: maximum number of trajectories available to the run.
        settings: settings of the simulation.
        sampler: sampler that only this run uses.
    """

    def __init__(
        self,
        shape: batches.NoiseShape,
        thresholds: Sequence[float],
        max_trajectories: int,
        settings: SubsetSettings,
        sampler: conditional_sampler.ConditionalSampler,
    ) -> None:
        self._shape = shape
        self._thresholds = thresholds
        self._sampler = sampler
        self.draws = settings.choose_draws(max_trajectories, len(thresholds))
        self.max_trajectories = min(max_trajectories, self.draws * len(thresholds))
        self.levels: list[subset_estimate.SubsetLevel] = []
        self.chains: conditional_sampler.Chains | None = None
        self.result: subset_estimate.SubsetEstimate | None = None

    def run(self) -> batches.Requests:
        """Go through the levels. Call this once."""
        sampler = self._sampler
        chains = yield from sampler.draw_independent(self.draws, self._shape)
        for number, threshold in enumerate(self._thresholds, start=1):
            self.levels.append(subset_estimate.make_level(chains, threshold))
            starts = conditional_sampler.find_starts(chains, threshold)
            if not starts.size:
                self.result = subset_estimate.estimate_without_failures(
                    self.levels,
                    subset_estimate.SubsetEnd.MISSED,
                    self.draws,
                    sampler.trajectories_run,
                )
                return
            if number < len(self._thresholds):
                is_last = number + 1 == len(self._thresholds)
                left = self.max_trajectories - sampler.trajectories_requested
                chosen = left if is_last else min(self.draws - len(starts), left)
                moves = max(chosen // len(starts), 0)
                chains = yield from sampler.move_chains(chains, threshold, starts, moves)
        self.chains = chains
        self.result = subset_estimate.estimate_from_failures(
            self.levels, chains, self.draws, sampler.trajectories_run
        )


WIDE_SHARE = 0.05
"""Share of the budget that is drawn of wide noise."""

WIDE_REACH = 4.0
"""The mean of |z|² is that of p(z) and the square of this. [sigma]"""

MOST_WIDE_VALUES = 40
"""Values of a trajectory beyond which the weights of wide noise say nothing: none is drawn."""


class WideEstimate(NamedTuple):
    """Estimates of a probability from the weights p(z) ÷ q(z) of failures among draws from q.

    Attributes:
        probability: sum of the weights ÷ number of draws. It is unbiased, but a single weight may
            dominate.
        without_largest: the same without the largest weight; too low on average.
    """

    probability: float
    without_largest: float


class WideNoise:
    """An estimate of P(robustness <= 0) from independent draws of N(0, s²·I), s > 1.

    It is unbiased (importance sampling) but has a large error. It shows failures that samples of
    p(z) never come near: chains miss them if robustness falls faster elsewhere.

    Attributes:
        trajectories_run: number of trajectories with known robustness.
        estimate: estimate from the failures among the draws; None before the end.

    Args:
        draws: number of draws.
        shape: steps and channels of the noise.
        rng: generator of every draw.
    """

    def __init__(self, draws: int, shape: batches.NoiseShape, rng: np.random.Generator) -> None:
        self._rng = rng
        self._draws = draws
        self._shape = shape
        self.trajectories_run = 0
        self.estimate: WideEstimate | None = None

    def run(self) -> batches.Requests:
        """Draw all trajectories at once. Call this once."""
        size = prod(self._shape)
        # The mean of |z|² is size · scale², hence size + WIDE_REACH².
        scale = sqrt(1.0 + WIDE_REACH**2 / size)
        z = scale * self._rng.standard_normal((self._draws, *self._shape))
        robustness = yield (z,)
        ran = ~np.isnan(robustness)
        self.trajectories_run = int(np.count_nonzero(ran))
        failures = z[robustness <= 0.0].reshape(-1, size)
        wide, prior = (
            gaussian_mixture.make_scaled_proposal(size, scale),
            gaussian_mixture.make_prior_proposal(size),
        )
        log_weights = prior.log_density(failures) - wide.log_density(failures)
        # Errored draws stay in the denominator: they count as no failure.
        shares = np.exp(log_weights) / max(len(z), 1)
        rest = shares.sum() - shares.max(initial=0.0)
        self.estimate = WideEstimate(float(shares.sum()), float(rest))


class PlainDraws:
    """Draws from p(z) with the rest of a budget, after an estimator that gave no number.

    The draws are new, and their number was fixed beforehand. So their share of failures is
    unbiased, independently of the estimator's results.

    Attributes:
        counts: counts of the draws by outcome; None before the end.

    Args:
        draws: number of draws.
        shape: steps and channels of the noise.
        seed: seed of every draw.
    """

    def __init__(self, draws: int, shape: batches.NoiseShape, seed: Sequence[int]) -> None:
        self._draws = draws
        self._shape = shape
        self._rng = np.random.default_rng([*seed])
        self.counts: PlainCounts | None = None

    def run(self) -> batches.Requests:
        """Draw all trajectories, a part at a time. Call this once."""
        counts = PlainCounts()
        while left := self._draws - counts.draws:
            z = self._rng.standard_normal((min(left, PLAIN_PART), *self._shape))
            robustness = yield (z,)
            counts = PlainCounts(
                counts.draws + len(z),
                counts.failures + int(np.count_nonzero(robustness <= 0.0)),
                counts.errored + int(np.count_nonzero(np.isnan(robustness))),
            )
        self.counts = counts


class PlainCounts(NamedTuple):
    """Numbers of draws from p(z), of failures and of errors."""

    draws: int = 0
    failures: int = 0
    errored: int = 0


PLAIN_PART = 1_000
"""Plain draws whose noise is in memory at a time."""


class SubsetSimulation:
    """P(robustness <= 0) for noise z, (steps, channels), of independent standard normal values.

    The same seed and robustness give the same estimate.

    With `parallel`, chains do not wait for other groups or runs, except at the end of a level,
    whose samples start the chains of the next level.

    Args:
        shape: steps and channels of the noise.
        budget: maximum number of requested trajectories.
        settings: settings of the simulation.
        seed: seed of every draw.
        parallel: number of trajectories to run at a time; None for waves, which move every chain of
            all runs once.

    Attributes:
        first: run that chooses the levels.
        end: reason why the first run ended; None before its end.
        runs: all runs, the first run first, once it has reached failures; otherwise empty.
        wide: run of wide noise; None before the end of the first run, or without wide noise.
        plain: draws from p(z) with the rest of the budget, if the first run did not reach failures;
            otherwise None.
    """

    def __init__(
        self,
        shape: batches.NoiseShape,
        budget: int,
        settings: SubsetSettings,
        seed: Sequence[int],
        parallel: int | None = None,
    ) -> None:
        self._shape = shape
        self._budget = budget
        self._settings = settings
        self._seed = tuple(seed)
        self._parallel = parallel
        self._run_together = batches.run_side_by_side if parallel else batches.run_in_waves
        self._samplers: list[conditional_sampler.ConditionalSampler] = []
        self.first = FirstRun(shape, budget, settings, self._make_sampler())
        self.runs: list[FirstRun | LevelRun] = []
        self.wide: WideNoise | None = None
        self.plain: PlainDraws | None = None
        self.end: subset_estimate.SubsetEnd | None = None

    @property
    def trajectories_run(self) -> int:
        """Number of trajectories with known robustness so far, over all runs.

        Plain draws are not included.
        """
        wide = self.wide.trajectories_run if self.wide else 0
        return wide + sum(each.trajectories_run for each in self._samplers)

    def run(self) -> batches.Requests:
        """Request the trajectories of all runs.

        Call this once; afterwards `runs` have the results. If the first run does not reach
        failures, `runs` stays empty, and the rest of the budget is drawn from p(z).
        """
        self.end = yield from self.first.run()
        settings, thresholds = self._settings, [level.threshold for level in self.first.levels]
        spent = self._samplers[0].trajectories_requested
        left = self._budget - spent
        if self.end is not subset_estimate.SubsetEnd.REACHED:
            if left > 0 and self._samplers[0].trajectories_run:
                # A stream behind those of the runs and of wide noise.
                self.plain = PlainDraws(left, self._shape, (*self._seed, settings.runs + 1))
                yield from self.plain.run()
            return
        most_wide = 0
        if prod(self._shape) <= MOST_WIDE_VALUES:
            free = max(left - settings.count_reserved(len(thresholds)), 0)
            most_wide = min(ceil(WIDE_SHARE * self._budget), free)
        others = [
            LevelRun(
                self._shape,
                thresholds,
                (left - most_wide) // (settings.runs - 1),
                settings,
                self._make_sampler(),
            )
            for _ in range(1, settings.runs)
        ]
        self.runs = [self.first, *others]
        running = [each.run() for each in others]
        planned = spent + sum(each.max_trajectories for each in others)
        # A share of what is really run: the runs may take less than the budget.
        if draws := min(most_wide, ceil(WIDE_SHARE * planned)):
            # The stream behind those of the runs, whose numbers are smaller.
            rng = np.random.default_rng([*self._seed, settings.runs])
            self.wide = WideNoise(draws, self._shape, rng)
            running.append(self.wide.run())
        yield from self._run_together(running)

    def _make_sampler(self) -> conditional_sampler.ConditionalSampler:
        # A stream of its own, so that a run's draws do not depend on how far other runs have
        # come.
        rng = np.random.default_rng([*self._seed, len(self._samplers)])
        sampler = conditional_sampler.ConditionalSampler(
            rng, self._settings.acceptance, self._parallel
        )
        self._samplers.append(sampler)
        return sampler


def simulate_subsets(
    robustness: batches.Robustness,
    shape: batches.NoiseShape,
    budget: int,
    settings: SubsetSettings,
    seed: int,
) -> SubsetSimulation:
    """Return a finished `SubsetSimulation` with a function as robustness.

    This is for benchmarks and tests; campaigns run the simulation through the method `subset`.

    Raises:
        InvalidValue: robustness is not finite, or not one value for each trajectory.
    """
    simulation = SubsetSimulation(shape, budget, settings, (seed,))
    batches.answer_requests(simulation.run(), robustness)
    return simulation


def _find_next_threshold(values: batches.Array, before: float, share: float) -> float | None:
    """Return the robustness that a share of the values reaches, but at least 0.

    If ties keep this quantile at the level before, return the next smaller value; None without one.
    """
    ordered = np.sort(values, axis=None)
    quantile = float(ordered[ceil(share * ordered.size) - 1])
    if quantile >= before:
        smaller = ordered[ordered < before]
        if not smaller.size:
            return None
        quantile = float(smaller[-1])
    return max(quantile, 0.0)
