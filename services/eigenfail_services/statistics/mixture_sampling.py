"""The probability of a rare failure by importance sampling from a mixture over all regions.

P(failure) = E_q[1{failure} · p(z) / q(z)]. A single normal that follows the failures settles on one
of several regions, and then estimates only the share of this region. Here the regions are found
first, by noise p(z / s) with larger standard deviations s. Such noise meets a region at distance b
from the origin in about Q(b / s) of the episodes. So regions of very different probability are met
about equally often. Short Markov chains lead these failures to places where p(z | failure) is
large, and each chain keeps its region. A mixture of normals is fitted to the ends of the chains,
refitted twice to the weighted failures that it draws, and then fixed. The estimate uses only the
last draws, which come from a single q. It is unbiased; an errored episode counts as not failed. The
draws are stratified by component, but their variance is estimated as for independent draws. If no
mixture is fitted, or if its trial promises too few effective failures, the rest of the budget goes
to another estimator. Its draws are new, so neither its estimate nor its interval depends on the
reason for the change.

Sources: Owen and Zhou 2000, J. Am. Stat. Assoc. 95, 135–143 (mixtures, defensive components);
Veach and Guibas 1995 (the balance heuristic, for the weights of the refits); Cotter et al. 2013,
Statistical Science 28, 424–446 (moves); Vehtari et al. 2024, JMLR 25 (72) (tails of weights).
"""

from collections.abc import Generator, Sequence
from math import log, prod, sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from eigenfail_services.statistics import gaussian_mixture, subset_estimate, subset_simulation
from eigenfail_services.statistics.batches import Array, Batches, NoiseShape, Requests

Mask = NDArray[np.bool_]

SCALES = (1.0, 1.4, 2.0, 2.8, 4.0)
"""Standard deviations at which failures are looked for. [sigma]"""

ENOUGH_FAILING = 0.04
"""Share of failures at which a scale is wide enough. The smallest such scale is taken: wider noise
lies further from the failures that matter."""

SCALE_SHARE, WIDE_SHARE, CHAIN_SHARE, TRIAL_SHARE = 0.02, 0.1, 0.25, 0.1
"""Shares of the budget: of each scale, of the chosen one again, of the chains, and of each trial of
a mixture. The rest, 0.35 or more, is drawn from the last mixture. Chosen on half spaces, two
corners and four branches with seeds that no figure rests on."""

FEWEST_DRAWS = 20
"""Of each scale."""

FEWEST_FAILURES = 9
"""Failures of the noise at all scales below which no mixture is fitted: a third of the chains that
start from them check it."""

MOVES, MOST_MOVES = 15, 25
"""Moves of a chain: as many as it takes to forget the wide noise in ten dimensions; at most."""

ACCEPTANCE = 0.4

FIRST_STEP, SMALLEST_STEP = 0.6, 0.05

FEWEST_EFFECTIVE = 25
"""Effective failures below which nothing is printed. With fewer than there are values of noise
nothing is printed either: of 100 campaigns on a half space in 40 dimensions 14 of the 16 intervals
that were printed without this rule held the probability."""

LEAST_PROMISE = 0.2
"""Share of the needed effective failures that the second trial must promise. Its mixture is
refitted before the last draws and is then better, as a rule by less than five times."""

FEWEST_FITTED = 20
"""Failures of a trial below which the mixture is not refitted."""

FIRST_MIXTURE_SHARE = 0.2
"""Share of the first mixture in the later ones, so that no refit loses a region."""

TEMPERING = 0.8

SUCCESSOR = 1
"""What the seed of the next estimator has besides that of this one."""


class ProposalDraws(NamedTuple):
    """Independent draws of one proposal, without errored episodes.

    Attributes:
        z: shape (n, size).
        failed: shape (n,).
        proposal: proposal of the draws.
    """

    z: Array
    failed: Mask
    proposal: gaussian_mixture.MixtureProposal


class MixtureResult(NamedTuple):
    """Result of the last draws.

    Attributes:
        draws: number of the last draws, including errored draws.
        errored: number of errored draws.
        weights: p / q of the draws' failures, shape (failures,).
        at_ends: p / q at the ends of all chains, shape (ends,).
        at_unseen: p / q at the ends that no fit has seen.
        uncovered: share of the unseen ends with p / q many times its mean over failures.
    """

    draws: int
    errored: int
    weights: Array
    at_ends: Array
    at_unseen: Array
    uncovered: float

    @property
    def probability(self) -> float:
        """Mean of the weights over all draws, 0 without a failure: P(failure and ran)."""
        return float(self.weights.sum()) / self.draws

    @property
    def effective(self) -> float:
        """Effective number of failures: (sum of weights)² ÷ sum of their squares (Kish 1965)."""
        return subset_estimate.count_effective(self.weights)

    @property
    def effective_for_variance(self) -> float:
        """Effective number of failures behind the estimated variance: (sum w²)² ÷ sum w⁴.

        If a few weights make up most of the variance, it is smaller than `effective`. The variance
        is then known only as well as from this number of draws.
        """
        return subset_estimate.count_effective(np.square(self.weights))

    @property
    def cv(self) -> float:
        """Coefficient of variation of `probability`.

        Rare heavy weights are often missing among the draws, and their variance with them. So two
        lower bounds apply. The mean square of the largest weights is taken to be at least the mean
        square of the distribution fitted to them. The variance is taken to be at least the variance
        from the weights at the chains' ends, because the mean of weights over failures is E_q[w²] /
        P. In a region that q half lost, these weights are heavy, and draws are few. Ends that a fit
        has seen have lighter weights, but there are more of them, and a region may have only such
        ends.
        """
        squares = np.square(np.sort(self.weights))
        total = float(squares.sum())
        if tail := fit_tail(self.weights):
            seen = float(squares[-tail.size :].sum())
            total += max(tail.size * tail.find_mean_square() - seen, 0.0)
        drawn = total * self.draws / float(self.weights.sum()) ** 2
        at_ends = max(find_upper_mean(self.at_ends), find_upper_mean(self.at_unseen))
        return sqrt(max(drawn - 1.0, at_ends / self.probability - 1.0, 0.0) / self.draws)


def find_upper_mean(weights: Array) -> float:
    """Return the mean of a few weights plus `STANDARD_ERRORS` standard errors."""
    if len(weights) < 2:
        return float(weights.sum())
    error = float(weights.std(ddof=1)) / sqrt(len(weights))
    return float(weights.mean()) + STANDARD_ERRORS * error


STANDARD_ERRORS = 2.0
"""Chosen with seeds that no figure rests on: with four regions 104 of 104 intervals held the
probability, 102 with the unseen ends alone, and 97 with none; they were 14 % wider."""

HELD_OUT = 3
"""Every third chain is kept from the fit, to check the mixture with."""

UNCOVERED_WEIGHT = 30.0
"""Times the mean weight over failures from which the end of a chain counts as not covered."""


class MixtureSampling:
    """P(failure) for noise z, shape (steps, channels), of independent standard normal values.

    The same seed and robustness give the same estimate.

    Args:
        shape: steps and channels of the noise.
        budget: maximum number of requested episodes.
        components: maximum number of fitted components of the mixture.
        seed: seed of every draw.

    Attributes:
        size: number of noise values of an episode.
        episodes_run: number of episodes with known robustness.
        found_failures: number of failures of the noise at all scales; None before all scales were
            run.
        are_failures_rare: whether so few draws from p(z) failed that a search is worthwhile.
        promised: effective number of failures to expect from the last draws, by the second trial;
            None before the trial.
        result: result of the last draws; None before the end, and without last draws.
        successor: estimator for the rest of the budget if no mixture was fitted, or if its trial
            promises too little. It is a subset simulation, or plain draws if failures are not rare
            or if the rest is too small for a subset simulation.
    """

    def __init__(
        self, shape: NoiseShape, budget: int, components: int, seed: Sequence[int]
    ) -> None:
        self._shape = shape
        self.size = prod(shape)
        self._budget = budget
        self._components = components
        self._seed = tuple(seed)
        self._rng = np.random.default_rng([*seed])
        self._requested = 0
        self.episodes_run = 0
        self.found_failures: int | None = None
        self.are_failures_rare = True
        self.promised: float | None = None
        self.result: MixtureResult | None = None
        self.successor: subset_simulation.SubsetSimulation | subset_simulation.PlainDraws | None = (
            None
        )

    def run(self) -> Requests:
        """Find the regions, fit the mixture, and draw from it. Call this once."""
        wide, scale = yield from self._draw_wide_noise()
        failures = np.concatenate([draws.z[draws.failed] for draws in wide])
        self.found_failures = len(failures)
        if len(failures) < FEWEST_FAILURES or not self.are_failures_rare:
            if self.episodes_run:
                yield from self._hand_on()
            return
        ends = yield from self._move_chains(failures)
        prior, scaled = (
            gaussian_mixture.make_prior_proposal(self.size),
            gaussian_mixture.make_scaled_proposal(self.size, scale),
        )
        broad = prior.components + scaled.components
        # The chains start from failures in random order, so that every third one is a random
        # choice.
        held_out = np.arange(len(ends)) % HELD_OUT == HELD_OUT - 1
        known = ends[~held_out]
        pure = gaussian_mixture.fit_mixture(
            known, np.ones(len(known)), self._components, (), self._rng
        )
        first = mixture = gaussian_mixture.add_broad_components(pure, broad).even_out()
        seen = wide
        for _ in range(2):
            seen = [*seen, (yield from self._draw(mixture, int(TRIAL_SHARE * self._budget)))]
            if (refit := self._refit(seen, broad)) is not None:
                mixture = refit.join(first, FIRST_MIXTURE_SHARE)
        count = self._budget - self._requested
        # In proportion to the draws: the last ones are so many times those of the trial.
        self.promised = count_effective_failures(seen[-1]) * count / int(TRIAL_SHARE * self._budget)
        if self.promised < LEAST_PROMISE * count_needed(self.size):
            yield from self._hand_on()
            return
        last = yield from self._draw(mixture, count)
        self.result = make_result(last, count, ends, held_out)

    def _hand_on(self) -> Requests:
        """Give the rest of the budget to another estimator.

        This decision never depends on last draws, which do not exist yet: choosing between two
        estimators by their results would bias both.
        """
        self.successor = self._choose_successor(self._budget - self._requested)
        yield from self.successor.run()

    def _choose_successor(
        self, left: int
    ) -> subset_simulation.SubsetSimulation | subset_simulation.PlainDraws:
        settings, seed = subset_simulation.SubsetSettings(), (*self._seed, SUCCESSOR)
        if self.are_failures_rare and left >= settings.count_fewest_trajectories():
            return subset_simulation.SubsetSimulation(self._shape, left, settings, seed)
        return subset_simulation.PlainDraws(left, self._shape, seed)

    def _draw(
        self, proposal: gaussian_mixture.MixtureProposal, count: int
    ) -> Generator[Batches, Array, ProposalDraws]:
        z = proposal.draw(count, self._rng)
        robustness = yield from self._request(z)
        ran = ~np.isnan(robustness)
        return ProposalDraws(z[ran], robustness[ran] <= 0.0, proposal)

    def _request(self, z: Array) -> Generator[Batches, Array, Array]:
        robustness = yield (z.reshape(len(z), *self._shape),)
        self._requested += len(z)
        self.episodes_run += int(np.count_nonzero(~np.isnan(robustness)))
        return robustness

    def _draw_wide_noise(self) -> Generator[Batches, Array, tuple[list[ProposalDraws], float]]:
        """Draw noise at every scale, and more at the best; return all draws and the best scale."""
        count = max(int(SCALE_SHARE * self._budget), FEWEST_DRAWS)
        proposals = [gaussian_mixture.make_scaled_proposal(self.size, scale) for scale in SCALES]
        wide = []
        for proposal in proposals:
            draws = yield from self._draw(proposal, count)
            wide.append(draws)
        shares = [draws.failed.mean() if len(draws.failed) else 0.0 for draws in wide]
        enough = [place for place, share in enumerate(shares) if share >= ENOUGH_FAILING]
        chosen = enough[0] if enough else int(np.argmax(shares))
        self.are_failures_rare = shares[0] < ENOUGH_FAILING
        more = yield from self._draw(proposals[chosen], int(WIDE_SHARE * self._budget))
        return [*wide, more], SCALES[chosen]

    def _move_chains(self, failures: Array) -> Generator[Batches, Array, Array]:
        """Lead failures of wider noise to large p(z | failure); return the ends of the chains.

        Moves leave p(z) invariant, and are accepted if the episode still fails. They alternate
        between preconditioned Crank–Nicolson moves and redraws of random values of z.
        """
        rng, budget = self._rng, int(CHAIN_SHARE * self._budget)
        # Rather fewer chains than too few moves of each: a short chain still shows the wide
        # noise.
        chains = min(len(failures), max(budget // MOVES, FEWEST_DRAWS))
        z = failures[rng.choice(len(failures), chains, replace=False)]
        step, share = np.full((chains, 1), FIRST_STEP), np.full((chains, 1), 0.5)
        for move in range(min(budget // chains, MOST_MOVES)):
            fresh = rng.standard_normal(z.shape)
            mixed = np.sqrt(1.0 - step**2) * z + step * fresh
            replaced = np.where(rng.random(z.shape) < share, fresh, z)
            is_mixed = move % 2 == 0
            # False where robustness is NaN, so that the chain stays.
            accept = (yield from self._request(mixed if is_mixed else replaced)) <= 0.0
            z = np.where(accept[:, None], mixed if is_mixed else replaced, z)
            # Each of the two kinds of moves is made, and adapted, every other time.
            change = np.exp((accept[:, None] - ACCEPTANCE) / sqrt(move // 2 + 1))
            if is_mixed:
                step = np.clip(step * change, SMALLEST_STEP, 1.0)
            else:
                share = np.clip(share * change, 1.0 / self.size, 1.0)
        return z

    def _refit(
        self, seen: Sequence[ProposalDraws], broad: Sequence[gaussian_mixture.NormalComponent]
    ) -> gaussian_mixture.MixtureProposal | None:
        """Return a mixture that is fitted to all weighted failures; None if there are too few.

        If a few failures have most of the weight, all weights are raised to a power below 1.
        """
        z, log_weights = weigh_by_balance(seen)
        if len(z) < FEWEST_FITTED:
            return None
        wanted = min(max(4 * self.size, 60), 0.5 * len(z))
        # Relative to the largest, as weights may be too small for doubles.
        power, relative = 1.0, log_weights - log_weights.max()
        while subset_estimate.count_effective(np.exp(power * relative)) < wanted and power > 0.02:
            power *= TEMPERING
        weights = np.exp(power * relative)
        return gaussian_mixture.fit_mixture(
            z, weights / weights.mean(), self._components, broad, self._rng
        )


def count_needed(values: int) -> int:
    """Return the effective number of failures that an estimate needs, for `values` noise values."""
    return max(FEWEST_EFFECTIVE, values)


def count_effective_failures(draws: ProposalDraws) -> float:
    """Return the effective number of failures among draws of one proposal."""
    failures = draws.z[draws.failed]
    if not len(failures):
        return 0.0
    prior = gaussian_mixture.make_prior_proposal(failures.shape[1])
    log_weights = prior.log_density(failures) - draws.proposal.log_density(failures)
    return subset_estimate.count_effective(np.exp(log_weights - log_weights.max()))


def weigh_by_balance(seen: Sequence[ProposalDraws]) -> tuple[Array, Array]:
    """Return the failures of several proposals, (n, size), and their log weights, (n,).

    The weight is p(z) ÷ sum_j n_j · q_j(z), with n_j draws of proposal j (the balance heuristic).
    """
    z = np.concatenate([draws.z[draws.failed] for draws in seen])
    prior = gaussian_mixture.make_prior_proposal(z.shape[1])
    parts = [
        log(len(draws.z)) + draws.proposal.log_density(z) for draws in seen if len(draws.z) > 0
    ]
    return z, prior.log_density(z) - np.logaddexp.reduce(parts)


def make_result(last: ProposalDraws, count: int, ends: Array, is_held_out: Mask) -> MixtureResult:
    """Return the result of the last draws, with their coverage of failures that no fit has seen.

    Over failures, the mean of p / q is E_q[w²] / P. At a failure that q hardly reaches, p / q is
    much larger. This happens in a lost region. It happens nearly everywhere in high dimensions, if
    the means of components are uncertain because failures are few. The weights of the draws
    themselves show neither case.

    Args:
        last: draws of the last mixture that ran, without errored ones.
        count: number of the mixture's draws, including errored draws. Errors are more frequent
            under the mixture than under p(z), so they cannot be left out of the mean.
        ends: ends of all chains, shape (n, size).
        is_held_out: mask of the ends that were kept from every fit, shape (n,).
    """
    prior = gaussian_mixture.make_prior_proposal(ends.shape[1])
    failures = last.z[last.failed]
    weights = np.exp(prior.log_density(failures) - last.proposal.log_density(failures))
    errored = count - len(last.z)
    if not len(weights):
        return MixtureResult(count, errored, weights, weights, weights, 1.0)
    typical = float(np.square(weights).sum() / weights.sum())
    at_ends = np.exp(prior.log_density(ends) - last.proposal.log_density(ends))
    at_unseen = at_ends[is_held_out]
    uncovered = float(np.mean(at_unseen > UNCOVERED_WEIGHT * typical))
    return MixtureResult(count, errored, weights, at_ends, at_unseen, uncovered)


class WeightTail(NamedTuple):
    """A generalised Pareto distribution of the largest weights.

    Attributes:
        size: number of weights in the tail.
        start: value that the weights of the tail exceed.
        scale: scale of the distribution.
        shape: shape of the distribution. Above 0.7, the sum of the weights cannot be trusted, even
            if its variance is small (Vehtari et al. 2024).
    """

    size: int
    start: float
    scale: float
    shape: float

    def find_mean_square(self) -> float:
        """Return the mean square of the tail's weights, with the shape limited to its bounds."""
        shape = min(max(self.shape, LEAST_SHAPE), LARGEST_SHAPE)
        mean = self.scale / (1.0 - shape)
        square = 2.0 * self.scale * mean / (1.0 - 2.0 * shape)
        return self.start**2 + 2.0 * self.start * mean + square


LEAST_SHAPE, LARGEST_SHAPE = 0.0, 0.45
"""Bounds of the shape in the variance, which is infinite from 0.5 on."""

FEWEST_IN_TAIL = 5


def fit_tail(weights: Array) -> WeightTail | None:
    """Return the distribution of the largest weights; None if there are too few.

    The estimator is from Zhang and Stephens (2009, Technometrics 51, 316–325), with the prior of
    Vehtari et al.
    """
    ordered = np.sort(weights)
    # The size of the tail by Vehtari et al.
    tail = int(min(len(ordered) / 5, 3.0 * sqrt(len(ordered))))
    if tail < FEWEST_IN_TAIL:
        return None
    start = float(ordered[-tail - 1])
    excess = ordered[-tail:] - start
    excess = excess[excess > 0.0]
    count = len(excess)
    if count < FEWEST_IN_TAIL:
        return WeightTail(tail, start, 0.0, 0.0)
    grid = np.arange(1, 31 + int(sqrt(count)))
    quartile = excess[int(count / 4 + 0.5) - 1]
    rates = 1.0 / excess[-1] + (1.0 - np.sqrt(len(grid) / (grid - 0.5))) / (3.0 * quartile)
    shapes = np.log1p(-rates[:, None] * excess).mean(axis=1)
    likelihoods = count * (np.log(-rates / shapes) - shapes - 1.0)
    posterior = np.exp(likelihoods - np.logaddexp.reduce(likelihoods))
    rate = float(posterior @ rates)
    shape = float(np.log1p(-rate * excess).mean())
    # Their prior counts as 10 weights with a shape of 0.5.
    return WeightTail(tail, start, -shape / rate, (count * shape + 10.0 * 0.5) / (count + 10.0))
