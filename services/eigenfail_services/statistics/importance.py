"""The probability of a failure from episodes that were drawn from known proposals q, not from p.

P = E_q[w·1(failure)], w = p/q. Whatever q has learnt from the rounds before, a round's mean of it
is not biased, nor is the mean over rounds (Owen and Zhou 2020, ACM TOMACS 30 (2)).
"""

from collections.abc import Sequence
from math import exp, inf, log, sqrt

import msgspec
import numpy as np
from numpy.typing import NDArray

from eigenfail.values import Estimate
from eigenfail_services.statistics.intervals import log_normal

Array = NDArray[np.float64]

BY = "importance sampling"

FEWEST_EFFECTIVE = 100.0
"""Effective failures below which nothing is printed: the largest weights are missing from small
samples, so that the sum is too small and seems surer than it is (Chatterjee and Diaconis 2018,
Annals of Applied Probability 28, 1099–1135). Of half spaces with P = 1e-3 … 1e-6 in 20 dimensions,
90 to 95 of 100 intervals hold the truth above it; what was wrong by a factor of 1.5 or more, in 80
dimensions by thousands, was worth less than 50."""

BLIND = "It knows nothing of failures unlike those that the proposal leads to."


class WeightedFailures(msgspec.Struct, frozen=True):
    """Sums over episodes; of weights as logarithms, which no weight is too large or small for.

    Attributes:
        episodes: how many were run.
        failures: how many of them failed.
        log_first: log of the sum of their weights.
        log_second: log of the sum of the squares of their weights.
    """

    episodes: float = 0.0
    failures: float = 0.0
    log_first: float = -inf
    log_second: float = -inf

    def after(self, log_weights: Array, episodes: int) -> "WeightedFailures":
        """With another round.

        Args:
            log_weights: log p − log q of the round's failures, shape (n,).
            episodes: how many of the round were run.
        """
        return WeightedFailures(
            episodes=self.episodes + episodes,
            failures=self.failures + len(log_weights),
            log_first=log_sum([self.log_first, *log_weights]),
            log_second=log_sum([self.log_second, *(2.0 * log_weights)]),
        )

    def effective(self) -> float:
        """Effective sample size: (sum of weights)² ÷ sum of their squares (Kish 1965)."""
        return exp(2.0 * self.log_first - self.log_second) if self.failures else 0.0

    def estimate(self) -> Estimate:
        """P with its log-normal interval, or why there is none."""
        effective, episodes = self.effective(), int(self.episodes)
        if effective < FEWEST_EFFECTIVE:
            return Estimate(
                by=BY, episodes=episodes, effective=effective, problem=too_few(self, effective)
            )
        probability = exp(min(self.log_first - log(self.episodes), 0.0))
        cv = sqrt(max(1.0 / effective - 1.0 / self.episodes, 0.0))
        return Estimate(
            by=BY,
            episodes=episodes,
            probability=probability,
            cv=cv,
            interval=log_normal(probability, cv),
            effective=effective,
            note=BLIND,
        )


def log_sum(logs: Sequence[float]) -> float:
    """log of the sum of exponentials."""
    return float(np.logaddexp.reduce(logs))


def too_few(sums: WeightedFailures, effective: float) -> str:
    """Why so few failures make no number, and what to do."""
    if not sums.failures:
        return (
            f"None of the {sums.episodes:.0f} episodes that count was a failure. Give it more "
            "episodes, or take method subset."
        )
    return (
        f"{sums.failures:.0f} failures are worth {effective:.1f} by their weights, and it takes "
        f"{FEWEST_EFFECTIVE:.0f}: a number would be far too small. Take method subset, or give it "
        "more episodes, larger rounds and no narrower noise: batch = 200, min_std = 1, "
        "mean_smoothing = 0.3."
    )
