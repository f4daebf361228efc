"""Confidence distributions of rates and probabilities, and bounds of sums of their products.

The rate of failures is T = λ_1 P_1 + … + λ_m P_m. Here λ_s is the number of encounters with
scenario s in an hour, and P_s the probability that an encounter ends in a failure. Each factor has
one-sided bounds at every confidence: exact bounds for counts, approximate bounds for other
evidence. Read as a function of the confidence, these bounds are two distributions, a lower and an
upper one:

- k encounters in H hours, a Poisson number: Gamma(k) ÷ H and Gamma(k + 1) ÷ H (Garwood 1936,
  Biometrika 28, 437–442).
- k failures of n episodes drawn from p(x): Beta(k, n - k + 1) and Beta(k + 1, n - k) (Clopper and
  Pearson 1934, Biometrika 26, 404–413). Errored and unresolved episodes count as failures in the
  upper one, and as none in the lower one.
- an estimate with an error between independent runs: log-normal, with Student's quantiles. The
  lower one is cut at the estimate.
- a value with a 95 % interval: log-normal with this median and these ends. The lower one is cut at
  value · exp(-s (1 + s) ÷ 2), with s the standard error of the logarithm.

**Cut.** A log-normal distribution has a mean above its median; with Student's quantiles, the mean
does not exist. The mean of a sum of draws would be above the truth, and with many summands the
lower bound as well. Draws of a lower distribution are therefore cut so that their mean is at most
the mean of an unbiased estimate. Counts have such a mean without a cut. The cut of an estimate from
runs, which is unbiased, is the estimate itself. A value whose logarithm has a normal error has the
mean exp(s² ÷ 2) times the truth; exp(-s² ÷ 2) takes that off, and exp(-s ÷ 2) covers the skewness
of sums of few. Only draws above the cut change. The lower bound of one such factor stays the same
up to s = 2.3, an interval of ÷ 88 to × 88, and is lower beyond.

**Melding** (Fay, Proschan and Brittain 2015, Biometrics 71, 146–156) bounds a function that rises
in all parameters. Its upper bound is the quantile of the function over independent draws from the
upper distributions; its lower bound uses draws from the lower distributions. For one factor, the
result is the factor's own bound. For several factors, the authors conjecture that melding covers at
least at its nominal confidence, and support this by simulation; `risk.cover.` among our claims
gives its coverage for sums as here. Melding adds one event to the observed count of each summand.
The gamma interval of Fay and Feuer (1997, Statistics in Medicine 16, 791–801) for a weighted sum of
Poisson rates adds one event in total. Hence melding is wider for many summands with few events.

**Monotone.** A further scenario adds non-negative draws to unchanged draws. Hence adding a scenario
lowers no bound, as long as the earlier scenarios share their noise as before. The method of
variance estimates recovery (Zou and Donner 2008, Statistics in Medicine 27, 1693–1702) has this
property as well. It needs a point estimate of each summand, which a stop rule may rule out, and
another rule for the products.

Draws are not random numbers. Each distribution is divided into `DRAWS` parts of equal probability,
and the parts are matched by permutations whose seeds are names. The same question has the same
answer, whatever the order of its scenarios; `risk.renamed` gives how far other names change bounds.

Campaigns with the same seed have the same noise: their errors may be correlated. The bounds are the
outer ones of two sums. One sum uses independent draws. The second sum matches probabilities of
equal noise in rising order: the strongest correlation, which narrows some sums of heavy tails.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from math import exp, inf, log, log1p, sqrt
from typing import Protocol
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

from eigenfail.intervals import ERROR, Z, find_crossing
from eigenfail.values.estimates import Estimate, Interval
from eigenfail.values.student_t import split_t_mass

Array = NDArray[np.float64]

DRAWS = 2**15
LEVELS: Array = (np.arange(DRAWS) + 0.5) / DRAWS
"""Confidences at the middles of parts of equal probability."""

NEARLY_NORMAL = 1e-6
"""Relative difference of a quantile from the normal one that is taken for none."""

MOST_FREEDOM = 1e9

GRID = np.linspace(-40.0, 40.0, 8_001)
"""Places of a density, in units of its width about its mode."""

T_GRID = np.linspace(-30.0, 30.0, 8_001)
"""Places of the density of Student's distribution, as inverse hyperbolic sines."""


class Confidence(Protocol):
    """Confidence distributions of a rate or a probability, which is not negative."""

    @property
    def value(self) -> float | None:
        """Point estimate; None if there is none without bias."""

    @property
    def centre(self) -> float:
        """A plausible value above 0, even without any observed event."""

    @property
    def variance(self) -> float:
        """Squared standard error of the estimate, above 0 even without any observed event."""

    def draw_lower(self) -> Array:
        """Return the quantiles of the lower distribution at `LEVELS`."""

    def draw_upper(self) -> Array:
        """Return the quantiles of the upper distribution at `LEVELS`."""


@dataclass(frozen=True)
class Stated:
    """A value with a 95 % interval, log-normal on both sides of it.

    Its lower bound is the lower end, unless the lower end is below value ÷ 88.

    Attributes:
        value: the value, which is the median; None if only the interval is known.
        low: lower end; equal to the value and the upper end if the value is exact.
        high: upper end.
    """

    value: float | None
    low: float
    high: float

    @property
    def centre(self) -> float:
        """The value, or else the geometric mean of the ends."""
        if self.value:
            return self.value
        return sqrt(self.low * self.high) if self.low else self.high / 2.0

    @property
    def variance(self) -> float:
        """Squared standard error of a normal distribution with this interval."""
        return ((self.high - self.low) / (2.0 * Z)) ** 2

    def draw_lower(self) -> Array:
        """Return quantiles, cut at value · exp(-s (1 + s) ÷ 2); zeros if the lower end is 0."""
        if not self.low:
            return np.zeros(DRAWS)
        error = log(self.centre / self.low) / Z
        cut = np.minimum(_draw_student(inf), -(1.0 + error) / 2.0)
        drawn: Array = self.centre * np.exp(error * cut)
        return drawn

    def draw_upper(self) -> Array:
        """Return quantiles; an exponential distribution's if the lower end is 0."""
        if self.low or not self.high:
            return self._draw()
        scaled: Array = np.log1p(-LEVELS) / log(ERROR / 2.0) * self.high
        return scaled

    def _draw(self) -> Array:
        if self.high <= self.low:
            return np.full(DRAWS, self.centre if self.high else 0.0)
        below, above = log(self.centre / self.low), log(self.high / self.centre)
        z = _draw_student(inf) / Z
        drawn: Array = self.centre * np.exp(np.where(z < 0.0, below, above) * z)
        return drawn


@dataclass(frozen=True)
class EventRate:
    """Rate of events, from a count with a Poisson distribution.

    Attributes:
        events: number of events.
        hours: time in which the events were counted. [h]
    """

    events: int
    hours: float

    @property
    def value(self) -> float:
        """Events in an hour."""
        return self.events / self.hours

    @property
    def centre(self) -> float:
        """Mean of the Gamma distribution half-way between the lower and the upper one."""
        return (self.events + 0.5) / self.hours

    @property
    def variance(self) -> float:
        """Variance of the same distribution."""
        return (self.events + 0.5) / self.hours**2

    def draw_lower(self) -> Array:
        """Return quantiles of Gamma(events) ÷ hours."""
        drawn: Array = _draw_gamma(self.events) / self.hours
        return drawn

    def draw_upper(self) -> Array:
        """Return quantiles of Gamma(events + 1) ÷ hours."""
        drawn: Array = _draw_gamma(self.events + 1) / self.hours
        return drawn


@dataclass(frozen=True)
class FailureShare:
    """Probability of failure, from episodes that were drawn from p(x).

    Attributes:
        failures: number of failures.
        errored: number of episodes that could not be completed.
        trials: number of episodes, errored ones included.
        value: the estimate, which may differ from the share because of a stop rule.
        unresolved: number of episodes that ended before what may have become a failure; see
            docs/measures.md.
    """

    failures: int
    errored: int
    trials: int
    value: float | None
    unresolved: int = 0

    def restrict_to(self, failures: int) -> "FailureShare":
        """Return the probability of one class of failures, with this many failures observed.

        Errored and unresolved episodes may have failed in any class.
        """
        return replace(self, failures=failures, value=None)

    @property
    def centre(self) -> float:
        """Mean of the Beta distribution half-way between the lower and the upper one."""
        return (self.failures + 0.5) / (self.trials + 1.0)

    @property
    def variance(self) -> float:
        """Variance of a share at that probability."""
        return self.centre * (1.0 - self.centre) / self.trials

    def draw_lower(self) -> Array:
        """Return quantiles of Beta(k, n - k + 1); zeros without a failure."""
        k = self.failures
        return _draw_beta(k, self.trials - k + 1) if k else np.zeros(DRAWS)

    def draw_upper(self) -> Array:
        """Return quantiles of Beta(k + 1, n - k); ones if only failures were seen.

        Errored and unresolved episodes count as failures.
        """
        k = self.failures + self.errored + self.unresolved
        return _draw_beta(k + 1, self.trials - k) if k < self.trials else np.ones(DRAWS)


@dataclass(frozen=True)
class RunEstimate:
    """Probability of failure, from an estimate with an error between independent runs.

    log P is the logarithm of the estimate plus `spread` times Student's distribution.

    Attributes:
        value: the estimate, above 0.
        cv: coefficient of variation, above 0.
        freedom: degrees of freedom, 1 or more; infinite if `cv` is known.
    """

    value: float
    cv: float
    freedom: float

    @classmethod
    def of(cls, estimate: Estimate) -> "RunEstimate | None":
        """Return what an estimate states, by its own interval; None if it states no interval.

        The degrees of freedom follow from the lower end of the interval, which is cut nowhere.
        """
        value, cv, interval = estimate.probability, estimate.cv, estimate.interval
        if estimate.bound or not value or not cv or interval is None or interval.low <= 0.0:
            return None
        return cls(value, cv, find_t_freedom(log(value / interval.low) / sqrt(log1p(cv**2))))

    @property
    def centre(self) -> float:
        """The estimate."""
        return self.value

    @property
    def variance(self) -> float:
        """Squared standard error."""
        return (self.value * self.cv) ** 2

    def draw_lower(self) -> Array:
        """Return quantiles, at most the estimate."""
        return self._draw_up_to(min(self.value, 1.0))

    def draw_upper(self) -> Array:
        """Return quantiles, at most 1."""
        return self._draw_up_to(1.0)

    def _draw_up_to(self, most: float) -> Array:
        spread = sqrt(log1p(self.cv**2))
        # The logarithm is cut before the exponential function could overflow.
        logs = np.minimum(log(self.value) + spread * _draw_student(self.freedom), log(most))
        drawn: Array = np.exp(logs)
        return drawn


def _invert(log_density: Array, places: Array) -> Array:
    """Return the quantiles at `LEVELS` of a density that is given at places in rising order."""
    density = np.exp(log_density - log_density.max())
    steps = np.diff(places) * (density[1:] + density[:-1]) / 2.0
    masses = np.concatenate(([0.0], np.cumsum(steps)))
    found: Array = np.interp(LEVELS, masses / masses[-1], places)
    return found


@lru_cache(32)
def _draw_gamma(shape: int) -> Array:
    if not shape:
        return np.zeros(DRAWS)
    logs = log(shape) + GRID / sqrt(shape)
    drawn: Array = np.exp(_invert(shape * logs - np.exp(logs), logs))
    return drawn


@lru_cache(32)
def _draw_beta(a: int, b: int) -> Array:
    logits = log(a / b) + GRID * sqrt(1.0 / a + 1.0 / b)
    found = _invert(a * logits - (a + b) * np.logaddexp(0.0, logits), logits)
    drawn: Array = 1.0 / (1.0 + np.exp(-found))
    return drawn


@lru_cache(16)
def _draw_student(freedom: float) -> Array:
    t = np.sinh(T_GRID)
    if freedom == inf:
        kernel = -(t**2) / 2.0
    else:
        kernel = -(freedom + 1.0) / 2.0 * np.log1p(t**2 / freedom)
    drawn: Array = np.sinh(_invert(kernel + np.log(np.cosh(T_GRID)), T_GRID))
    return drawn


@dataclass(frozen=True)
class RiskTerm:
    """A summand of the total: encounters in an hour times the probability of failure.

    Attributes:
        name: name of the scenario.
        exposure: encounters in an hour.
        probability: of failure in one encounter.
        noise: name of the noise of its episodes, equal where campaigns share a seed.
        episodes: number of episodes behind the probability.
    """

    name: str
    exposure: Confidence
    probability: Confidence
    noise: str
    episodes: int

    @property
    def value(self) -> float | None:
        """Estimate of its failures in an hour; None if there is none."""
        rate, probability = self.exposure.value, self.probability.value
        return None if rate is None or probability is None else rate * probability

    def draw_lower(self) -> Array:
        """Return draws of its failures in an hour from the lower distributions, shape (2, DRAWS).

        The first row is of independent draws, the second one of draws that equal noise matches.
        """
        return self._match(self.exposure.draw_lower(), self.probability.draw_lower())

    def draw_upper(self) -> Array:
        """Return the same from the upper distributions."""
        return self._match(self.exposure.draw_upper(), self.probability.draw_upper())

    def _match(self, rates: Array, shares: Array) -> Array:
        names = (f"failures {self.name}", self.noise)
        matched = np.stack([_permute(shares, name) for name in names])
        drawn: Array = _permute(rates, f"exposure {self.name}") * matched
        return drawn


def _permute(drawn: Array, name: str) -> Array:
    return drawn[_make_permutation(crc32(name.encode()))]


@lru_cache(32)
def _make_permutation(seed: int) -> NDArray[np.int64]:
    return np.random.default_rng(seed).permutation(DRAWS)


@dataclass(frozen=True)
class RateBounds:
    """Bounds of a rate.

    Attributes:
        interval: two-sided interval of 95 %.
        at_least: one-sided lower bound of 95 %.
        at_most: one-sided upper bound of 95 %.
    """

    interval: Interval
    at_least: float
    at_most: float


def bound_sum(terms: Sequence[RiskTerm]) -> RateBounds:
    """Return the bounds of the sum of terms, by melding: the outer ones of two matchings. [1/h]"""
    lower = np.zeros((2, DRAWS))
    for term in terms:
        lower += term.draw_lower()
    lows = np.quantile(lower, (ERROR / 2.0, ERROR), axis=1).min(axis=1)
    highs = _find_upper_quantiles(terms, (1.0 - ERROR, 1.0 - ERROR / 2.0))
    (low, at_least), (at_most, high) = lows.tolist(), highs.tolist()
    return RateBounds(Interval(low, high), at_least, at_most)


def bound_sum_above(terms: Sequence[RiskTerm]) -> float:
    """Return the one-sided upper bound of 95 % alone, as `bound_sum` finds it. [1/h]"""
    return float(_find_upper_quantiles(terms, (1.0 - ERROR,))[0])


def _find_upper_quantiles(terms: Sequence[RiskTerm], levels: Sequence[float]) -> Array:
    upper = np.zeros((2, DRAWS))
    for term in terms:
        upper += term.draw_upper()
    found: Array = np.quantile(upper, levels, axis=1).max(axis=1)
    return found


def bound_factor(known: Confidence) -> Interval:
    """Return the two-sided 95 % interval of one factor."""
    low = float(np.quantile(known.draw_lower(), ERROR / 2.0))
    return Interval(low, float(np.quantile(known.draw_upper(), 1.0 - ERROR / 2.0)))


def find_t_freedom(quantile: float) -> float:
    """Return the degrees of freedom of Student's distribution that has this 97.5 % quantile.

    They are 1 or more; infinite if the quantile is the normal distribution's.
    """
    if quantile <= Z * (1.0 + NEARLY_NORMAL):
        return inf
    return exp(
        find_crossing(0.0, log(MOST_FREEDOM), lambda at: split_t_mass(quantile, exp(at))[1] > ERROR)
    )
