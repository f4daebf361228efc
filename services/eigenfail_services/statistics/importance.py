"""A lower bound of the failure probability, from episodes of known proposals q instead of p.

P = E_q[w·1(failure)], w = p/q. Even if q has learnt from earlier rounds, the mean of a round is
unbiased, and so is the mean over rounds (Owen and Zhou 2020, ACM TOMACS 30 (2)). In a finite
sample, the mean is usually too low: a proposal that has moved to one of several failure regions
draws nothing from the rest. Neither the variance of the weights nor their effective number shows
it. With two equal regions, the sum is half of the truth, with a coefficient of variation of a few
percent. So the result is a lower bound, without an interval.
"""

from collections.abc import Sequence
from functools import lru_cache, singledispatch
from math import exp, inf, isnan, log, pi, sqrt

import msgspec
import numpy as np
from numpy.typing import NDArray

from eigenfail.values.disturbance import NoiseTrajectory
from eigenfail.values.estimates import IMPORTANCE_SAMPLING, ONE_REGION, Estimate
from eigenfail.values.shapes import ChannelShape, Markov, NoiseShape, PerChannel, Row
from eigenfail.values.student_t import LOG_SQRT_TWO_PI

Array = NDArray[np.float64]


BY = IMPORTANCE_SAMPLING


FEWEST_EFFECTIVE = 100.0
"""Effective failures below which nothing is printed: the largest weights are missing from small
samples, so that the sum is too small and seems surer than it is (Chatterjee and Diaconis 2018,
Annals of Applied Probability 28, 1099–1135). Of half spaces with P = 1e-3 … 1e-6 in 20 dimensions,
what was wrong by a factor of 1.5 or more, in 80 dimensions by thousands, was worth less than 50."""


ADVICE = "Take method subset, or give it more episodes."


NO_DENSITY = (
    "A failure was decided on with next to no randomness, so that it has no density to be weighed "
    "by. Take method subset, or a policy that stays random."
)


NOT_YET = "Not known yet: it rests on the second half of the budget; the first is for learning."


NO_ROUND = (
    "No round began in the second half of the budget, on which it rests. Take smaller rounds."
)


class WeightedFailures(msgspec.Struct, frozen=True):
    """Sums over episodes; sums of weights are logarithms, which cannot overflow or underflow.

    Attributes:
        episodes: number of episodes that ran.
        failures: number of failures.
        log_first: log of the sum of the failures' weights; NaN if a weight is unknown.
        log_second: log of the sum of the squared weights.
    """

    episodes: float = 0.0
    failures: float = 0.0
    log_first: float = -inf
    log_second: float = -inf

    def after(self, log_weights: Array, episodes: int) -> "WeightedFailures":
        """Return the sums with another round added.

        Args:
            log_weights: log p − log q of the round's failures, shape (n,); NaN for a failure
                without density under q.
            episodes: number of the round's episodes that ran.
        """
        return WeightedFailures(
            episodes=self.episodes + episodes,
            failures=self.failures + len(log_weights),
            log_first=_add_logs([self.log_first, *log_weights]),
            log_second=_add_logs([self.log_second, *(2.0 * log_weights)]),
        )

    def effective(self) -> float:
        """Return the effective sample size: (sum of weights)² ÷ sum of squares (Kish 1965)."""
        return exp(2.0 * self.log_first - self.log_second) if self.failures else 0.0

    def estimate(self, advice: str = ADVICE, note: str = ONE_REGION) -> Estimate:
        """Return a lower bound of P with its random error, or the reason why it is missing.

        Args:
            advice: advice if the effective number of failures is too small.
            note: reason why the result is a lower bound.
        """
        if isnan(self.log_first):
            return Estimate(by=BY, episodes=int(self.episodes), problem=NO_DENSITY)
        effective, episodes = self.effective(), int(self.episodes)
        if effective < FEWEST_EFFECTIVE:
            problem = explain_too_few(self, effective, advice)
            return Estimate(by=BY, episodes=episodes, effective=effective, problem=problem)
        # The sum of weights may exceed the number of episodes by chance; no probability exceeds
        # 1.
        probability = exp(min(self.log_first - log(self.episodes), 0.0))
        # The variance of the mean weight over its square: sum w² ÷ (sum w)² − 1 ÷ n.
        cv = sqrt(max(1.0 / effective - 1.0 / self.episodes, 0.0))
        return Estimate(
            by=BY,
            episodes=episodes,
            probability=probability,
            cv=cv,
            effective=effective,
            note=note,
            bound="lower",
        )


def _add_logs(logs: Sequence[float]) -> float:
    """Return the log of the sum of exponentials; NaN if a term is NaN."""
    # A weight that is not known makes the sum NaN, which is the answer and no warning.
    with np.errstate(invalid="ignore"):
        return float(np.logaddexp.reduce(logs))


def explain_nothing_counted(seen: int, budget: int) -> Estimate | None:
    """Return an estimate that explains why its value is missing; None before any episode.

    Args:
        seen: episodes observed so far.
        budget: budget of the campaign.
    """
    problem = NOT_YET if seen < budget else NO_ROUND
    return Estimate(by=BY, episodes=0, problem=problem) if seen else None


def explain_too_few(sums: WeightedFailures, effective: float, advice: str) -> str:
    """Return why there are too few failures for a number, with advice."""
    if not sums.failures:
        return (
            f"None of the {sums.episodes:.0f} episodes that count was a failure. Give it more "
            "episodes, or take method subset."
        )
    return (
        f"The failures ({sums.failures:.0f}) are worth {effective:.1f} by their weights, and it "
        f"takes {FEWEST_EFFECTIVE:.0f}: a number would be far too small. {advice}"
    )


NODES, WEIGHTS = np.polynomial.hermite_e.hermegauss(40)
"""E[f(z)] of a standard normal z is sum(w · f(x)) / sqrt(2 pi) (Gauss and Hermite)."""


def expected_log_probability(noise: NoiseTrajectory) -> float:
    """Return E[log p(a_1 … a_T)] for a from p, over the same steps at the same sigma.

    log p depends on z only through z²/2 and the slope of the shape at z_t. So the expectation is
    computed step by step: E[z²] = 1, and the slope by quadrature.
    """
    z = noise.z.astype(np.float64)
    # Row 0 is for the first step, row 1 for each later one.
    expected = expected_slopes(noise.shape, z.shape[1])[np.minimum(np.arange(len(z)), 1)]
    if isinstance(noise.shape, PerChannel) and len(z):
        for way, chain in noise.shape.rated.items():
            expected[:, way] = _average_events(chain, noise.sigma[:, way].tolist())
    known = 0.5 * z**2 + noise.shape.log_slopes(z, noise.sigma)
    return float(noise.log_probability + np.sum(known - 0.5 - expected))


@lru_cache(maxsize=256)
def expected_slopes(shape: NoiseShape | ChannelShape, channels: int) -> NDArray[np.float64]:
    """Return E[log |du_t / dz_t|] at the first and at each later step, shape (2, channels).

    If the rate of an event depends on the distance, the rate at distance 0 is used.
    """
    expected = _average_slopes(shape, channels)
    # It is cached: a caller that wrote to it would change all later answers.
    expected.setflags(write=False)
    return expected


@singledispatch
def _average_slopes(shape: NoiseShape | ChannelShape, channels: int) -> NDArray[np.float64]:
    one = np.ones((2, channels), np.float32)
    slopes = [shape.log_slopes(node * one.astype(np.float64), one) for node in NODES]
    expected: NDArray[np.float64] = np.tensordot(WEIGHTS, slopes, 1) / sqrt(2.0 * pi)
    return expected


@_average_slopes.register
def _(shape: Markov, channels: int) -> NDArray[np.float64]:
    slopes = _average_events(shape, (shape.rate, shape.rate))
    return np.repeat(slopes[:, None], channels, axis=1)


def _average_events(chain: Markov, sigma: Row) -> NDArray[np.float64]:
    """Return the mean of `Markov.log_slopes` at each step of one channel, shape (steps,)."""
    # An event is no smooth function of z, but its mean log probability has a closed form.
    means: NDArray[np.float64] = np.array(chain.mean_log_probabilities(sigma))
    return -0.5 - LOG_SQRT_TWO_PI - means


@_average_slopes.register
def _(shape: PerChannel, channels: int) -> NDArray[np.float64]:
    del channels  # it has a shape for each
    return np.concatenate([expected_slopes(each, 1) for each in shape.shapes], axis=1)
