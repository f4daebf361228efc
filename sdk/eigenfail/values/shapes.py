"""Shapes of the noise: how the standardised noise u follows from z.

z is independent and standard normal. A shape is a frozen struct that TOML and JSON name by its
`kind`. It computes u_t from z_t and u_{t-1} (`step`), the inverse (`step_back`), and the slope
(`log_slopes`). In a continuous shape, u_t has mean 0 and variance 1, so that sigma means the same
under every shape. In a shape of events, u_t is 1 during the event, and 0 otherwise. Only events
whose rate depends on the distance use the sigma of the step: it is the probability that the event
begins.
"""

from functools import lru_cache
from math import inf, log, log1p, sqrt
from typing import Annotated

import msgspec
import numpy as np
from numpy.typing import NDArray

from eigenfail.values import student_t
from eigenfail.values.arrays import Floats

Pair = tuple[float, float]
"""A longitudinal and a lateral value."""

Row = tuple[float, ...]
"""A value for each channel, at one step."""

Slopes = NDArray[np.float64]

MOST_LIKELY = 0.5
"""Largest probability that an event begins at a step."""

Correlation = Annotated[float, msgspec.Meta(ge=0.0, lt=1.0)]


class ShapeStruct(msgspec.Struct, frozen=True, forbid_unknown_fields=True, tag_field="kind"):
    """Base of all shapes, which a campaign names by their kind."""


class White(ShapeStruct, frozen=True, tag="white"):
    """The paper's noise: normal, and independent at every step. u = z."""

    def step(self, z: Row, _before: Row | None, _sigma: Row) -> Row:
        """Return u_t from z_t."""
        return z

    def step_back(self, u: Row, _before: Row | None, _sigma: Row) -> Row:
        """Return z_t from u_t."""
        return u

    def log_slopes(self, z: Slopes, _sigma: Floats) -> Slopes:
        """Return log |du_t / dz_t|, shape (steps, channels)."""
        return np.zeros(z.shape)

    def in_words(self) -> str:
        """Return the shape in words."""
        return "white: normal, independent at every step"


class Correlated(ShapeStruct, frozen=True, tag="ar1"):
    """An autoregressive process of order one on each of two axes, stationary from its first step.

    u_0 = z_0, u_t = phi · u_{t-1} + sqrt(1 - phi²) · z_t (Box and Jenkins, Time Series Analysis,
    section 3.2). Every u_t is standard normal, and values k steps apart have correlation phi^k.

    Attributes:
        longitudinal_correlation: phi between one step and the next; lateral_correlation likewise.
    """

    longitudinal_correlation: Correlation = 0.8
    lateral_correlation: Correlation = 0.8

    def step(self, z: Row, before: Row | None, _sigma: Row) -> Row:
        """Return u_t from z_t and u_{t-1}, which is None at the first step."""
        if before is None:
            return z
        (phi_x, phi_y), (new_x, new_y) = self._kept, self._new
        return phi_x * before[0] + new_x * z[0], phi_y * before[1] + new_y * z[1]

    def step_back(self, u: Row, before: Row | None, _sigma: Row) -> Row:
        """Return z_t from u_t and u_{t-1}."""
        # The first step is drawn from the stationary distribution, hence without a start-up
        # phase.
        if before is None:
            return u
        (phi_x, phi_y), (new_x, new_y) = self._kept, self._new
        return (u[0] - phi_x * before[0]) / new_x, (u[1] - phi_y * before[1]) / new_y

    def log_slopes(self, z: Slopes, _sigma: Floats) -> Slopes:
        """Return log |du_t / dz_t| = log sqrt(1 - phi²) after the first step, shape (steps, 2)."""
        slopes = np.zeros_like(z)
        slopes[1:] = [0.5 * log1p(-phi * phi) for phi in self._kept]
        return slopes

    @property
    def _kept(self) -> Pair:
        return self.longitudinal_correlation, self.lateral_correlation

    @property
    def _new(self) -> Pair:
        phi_x, phi_y = self._kept
        # 1 − phi² would lose its digits where phi is near 1.
        return sqrt((1.0 - phi_x) * (1.0 + phi_x)), sqrt((1.0 - phi_y) * (1.0 + phi_y))

    def in_words(self) -> str:
        """Return the shape in words."""
        phi_x, phi_y = self._kept
        by = f"{phi_x:g} (longitudinal) and {phi_y:g} (lateral)"
        return f"ar1: normal, correlated from step to step by {by}"


class HeavyTailed(ShapeStruct, frozen=True, tag="student_t"):
    """Student's t in unit variance, independent at every step: outliers are part of the sensor.

    u = T⁻¹(Φ(z)) · sqrt((nu - 2) / nu), with T the distribution function for nu degrees of freedom
    (quantile transform: Devroye 1986, Non-Uniform Random Variate Generation, section II.2).

    Attributes:
        degrees_of_freedom: nu; fewer give heavier tails. The kurtosis is finite above 4.
    """

    degrees_of_freedom: Annotated[float, msgspec.Meta(gt=2.0, le=1000.0)] = 5.0

    def step(self, z: Row, _before: Row | None, _sigma: Row) -> Row:
        """Return u_t from z_t."""
        nu, unit = self.degrees_of_freedom, self._unit
        return tuple([unit * student_t.map_normal_to_t(each, nu) for each in z])

    def step_back(self, u: Row, _before: Row | None, _sigma: Row) -> Row:
        """Return z_t from u_t."""
        nu, unit = self.degrees_of_freedom, self._unit
        return tuple([student_t.map_t_to_normal(each / unit, nu) for each in u])

    def log_slopes(self, z: Slopes, _sigma: Floats) -> Slopes:
        """Return log |du_t / dz_t|, shape (steps, channels)."""
        slopes = [
            student_t.log_t_slope(each, self.degrees_of_freedom) for each in z.ravel().tolist()
        ]
        return np.array(slopes).reshape(z.shape) + log(self._unit)

    @property
    def _unit(self) -> float:
        return sqrt((self.degrees_of_freedom - 2.0) / self.degrees_of_freedom)

    def in_words(self) -> str:
        """Return the shape in words."""
        nu = self.degrees_of_freedom
        return f"student_t: heavy tails of {nu:g} degrees of freedom, independent at every step"


Shape = White | Correlated | HeavyTailed
"""Shapes of the noise of a position, on both axes."""


class Autoregressive(ShapeStruct, frozen=True, tag="ar1"):
    """The process of `Correlated` on one channel.

    Attributes:
        correlation: phi between one step and the next.
    """

    correlation: Correlation = 0.8

    def step(self, z: Row, before: Row | None, _sigma: Row) -> Row:
        """Return u_t from z_t and u_{t-1}, which is None at the first step."""
        if before is None:
            return z
        phi, new = self.correlation, self._new
        return tuple([phi * last + new * each for each, last in zip(z, before, strict=True)])

    def step_back(self, u: Row, before: Row | None, _sigma: Row) -> Row:
        """Return z_t from u_t and u_{t-1}."""
        if before is None:
            return u
        phi, new = self.correlation, self._new
        return tuple([(each - phi * last) / new for each, last in zip(u, before, strict=True)])

    def log_slopes(self, z: Slopes, _sigma: Floats) -> Slopes:
        """Return log |du_t / dz_t| = log sqrt(1 - phi²) from step 1 on, shape (steps, channels)."""
        slopes = np.zeros_like(z)
        slopes[1:] = log(self._new)
        return slopes

    @property
    def _new(self) -> float:
        # As in `Correlated`: 1 − phi² would lose its digits.
        return sqrt((1.0 - self.correlation) * (1.0 + self.correlation))

    def in_words(self) -> str:
        """Return the shape in words."""
        return f"ar1: normal, correlated from step to step by {self.correlation:g}"


class Markov(ShapeStruct, frozen=True, tag="markov"):
    """An event that begins and ends: a Markov chain of two states (Norris 1997, 1.1).

    u_t = 1 (the event lasts) if z_t > Phi⁻¹(1 - P(u_t = 1 | u_{t-1})), else 0. Thus u has the
    distribution of the chain, and a larger z makes the event more likely, whatever the previous
    state. At the first step, P is the long-run share of steps with the event, at the rate of that
    step. If the rate is constant, the chain is therefore stationary.

    With `rate_per_m`, the event begins with probability min(0.5, rate + rate_per_m · d) at a step
    when the vehicle is at the distance d [m]. This probability takes the place of the channel's
    sigma.

    Attributes:
        rate: probability that the event begins at a step if it was absent at the step before.
        mean_steps: mean duration of the event, in steps.
        rate_per_m: growth of `rate` with each metre of distance.
    """

    rate: Annotated[float, msgspec.Meta(gt=0.0, le=MOST_LIKELY)] = 0.01
    mean_steps: Annotated[float, msgspec.Meta(ge=1.0, le=1000.0)] = 5.0
    # Where it is not given it is absent from texts, keys and digests: they stay as they were before
    # there was such a field.
    rate_per_m: Annotated[float, msgspec.Meta(ge=0.0, le=MOST_LIKELY)] | msgspec.UnsetType = (
        msgspec.UNSET
    )

    @property
    def growth_per_m(self) -> float:
        """Growth of the rate with each metre of distance; 0 if the rate is constant."""
        return 0.0 if isinstance(self.rate_per_m, msgspec.UnsetType) else self.rate_per_m

    def step(self, z: Row, before: Row | None, sigma: Row) -> Row:
        """Return u_t from z_t and u_{t-1}, which is None at the first step."""
        likely = self._probabilities(before, sigma)
        # A list inside of the tuple: a generator takes longer, and this runs at each step.
        pairs = zip(z, likely, strict=True)
        return tuple([1.0 if each > _find_threshold(p) else 0.0 for each, p in pairs])

    def step_back(self, u: Row, before: Row | None, sigma: Row) -> Row:
        """Return the mean of z_t, given u_{t-1} and u_t (rounded to 0 or 1)."""
        likely = self._probabilities(before, sigma)
        return tuple([_find_mean_z(each, p) for each, p in zip(u, likely, strict=True)])

    def log_slopes(self, z: Slopes, sigma: Floats) -> Slopes:
        """Return log of the density of z_t ÷ P(u_t | u_{t-1}), shape (steps, channels).

        The counterpart of log |du_t / dz_t| for an event: the log density of z minus the log
        probability of u.
        """
        slopes, before = [], None
        for row, at in zip(z.tolist(), sigma.tolist(), strict=True):
            u = self.step(tuple(row), before, at)
            likely = self._probabilities(before, at)
            masses = [p if each else 1.0 - p for each, p in zip(u, likely, strict=True)]
            slopes.append([-0.5 * to * to - log(m) for to, m in zip(row, masses, strict=True)])
            before = u
        return np.array(slopes).reshape(z.shape) - student_t.LOG_SQRT_TWO_PI

    def mean_log_probabilities(self, sigma: Row) -> list[float]:
        """Return the mean of log P(u_t | u_{t-1}) over the chain, at each step of one channel.

        Args:
            sigma: sigma of the channel at each step; at least one step.
        """
        rates, stays = self._find_rates(sigma), 1.0 - 1.0 / self.mean_steps
        lasting = self._find_share(rates[0])
        means = [_negative_entropy(lasting)]
        for begins in rates[1:]:
            entropies = _negative_entropy(stays), _negative_entropy(begins)
            means.append(lasting * entropies[0] + (1.0 - lasting) * entropies[1])
            lasting = lasting * stays + (1.0 - lasting) * begins
        return means

    def _find_share(self, begins: float) -> float:
        """Return the long-run share of steps with the event, if it begins with that probability."""
        return begins / (begins + 1.0 / self.mean_steps)

    def _find_rates(self, sigma: Row) -> Row:
        """Return the probability that the event begins, for each channel."""
        if not self.growth_per_m:
            return (self.rate,) * len(sigma)
        # Within its bounds also where a worker reported anything else.
        return tuple([min(max(self.rate, each), MOST_LIKELY) for each in sigma])

    def _probabilities(self, before: Row | None, sigma: Row) -> Row:
        """Return P(u_t = 1 | u_{t-1}) of each channel; at the first step, the stationary one."""
        rates = self._find_rates(sigma)
        # From the long run, as an episode begins anywhere in a drive, and not where events begin.
        if before is None:
            return tuple([self._find_share(begins) for begins in rates])
        ends = 1.0 / self.mean_steps
        pairs = zip(before, rates, strict=True)
        return tuple([1.0 - ends if last >= 0.5 else begins for last, begins in pairs])

    def in_words(self) -> str:
        """Return the shape in words."""
        growth = f" + {self.growth_per_m:g}·d" if self.growth_per_m else ""
        return (
            f"markov: begins with probability {self.rate:g}{growth} a step, lasts "
            f"{self.mean_steps:g} steps on average"
        )


def _negative_entropy(p: float) -> float:
    """Return p log p + (1 - p) log(1 - p), which is 0 for p = 0 and p = 1."""
    return sum(each * log(each) for each in (p, 1.0 - p) if each > 0.0)


# A constant rate asks for the same few values at every step.
@lru_cache(maxsize=64)
def _find_threshold(probability: float) -> float:
    """Return the value that a standard normal variable exceeds with that probability."""
    return -student_t.NORMAL.inv_cdf(probability) if probability > 0.0 else inf


def _find_mean_z(u: float, probability: float) -> float:
    """Return the mean of a standard normal z above its threshold, or below it if u < 0.5."""
    if probability == 0.0:
        return 0.0
    density = student_t.NORMAL.pdf(_find_threshold(probability))
    return density / probability if u >= 0.5 else -density / (1.0 - probability)


class Once(ShapeStruct, frozen=True, tag="once"):
    """One draw for the whole episode: u_t = z_0. Later z do not have an effect."""

    def step(self, z: Row, before: Row | None, _sigma: Row) -> Row:
        """Return u_t from z_t and u_{t-1}, which is None at the first step."""
        # z of later steps stay part of the noise, so that all channels have one shape of array.
        return z if before is None else before

    def step_back(self, u: Row, before: Row | None, _sigma: Row) -> Row:
        """Return z_t: u_t at the first step; then 0, because later z do not have an effect."""
        return u if before is None else (0.0,) * len(u)

    def log_slopes(self, z: Slopes, _sigma: Floats) -> Slopes:
        """Return log of density of z_t ÷ density of u_t | u_{t-1}, shape (steps, channels).

        After the first step, u is not random, so that only the density of z remains.
        """
        slopes = np.zeros_like(z)
        slopes[1:] = -0.5 * z[1:] ** 2 - student_t.LOG_SQRT_TWO_PI
        return slopes

    def in_words(self) -> str:
        """Return the shape in words."""
        return "drawn once an episode"


ChannelShape = White | Autoregressive | HeavyTailed | Markov | Once
"""Shapes of the noise of one channel."""


class PerChannel(ShapeStruct, frozen=True, tag="per_channel"):
    """A shape for each channel, in the order of the columns of z."""

    shapes: tuple[ChannelShape, ...]

    def step(self, z: Row, before: Row | None, sigma: Row) -> Row:
        """Return u_t from z_t and u_{t-1}, which is None at the first step."""
        return tuple(
            [
                shape.step((z[way],), None if before is None else (before[way],), (sigma[way],))[0]
                for way, shape in enumerate(self.shapes)
            ]
        )

    def step_back(self, u: Row, before: Row | None, sigma: Row) -> Row:
        """Return z_t from u_t and u_{t-1}."""
        befores = [None] * len(u) if before is None else [(each,) for each in before]
        return tuple(
            [
                shape.step_back((u[way],), befores[way], (sigma[way],))[0]
                for way, shape in enumerate(self.shapes)
            ]
        )

    def log_slopes(self, z: Slopes, sigma: Floats) -> Slopes:
        """Return the `log_slopes` of each channel's shape, shape (steps, channels)."""
        columns = [
            shape.log_slopes(z[:, [way]], sigma[:, [way]]) for way, shape in enumerate(self.shapes)
        ]
        return np.concatenate(columns, axis=1)

    @property
    def once(self) -> list[int]:
        """Columns of the channels whose error is drawn once an episode."""
        return [way for way, shape in enumerate(self.shapes) if isinstance(shape, Once)]

    @property
    def rated(self) -> dict[int, Markov]:
        """Events with a probability in place of a sigma, by their column."""
        return {
            way: shape
            for way, shape in enumerate(self.shapes)
            if isinstance(shape, Markov) and shape.growth_per_m
        }

    def drop_uncounted(self, z: Floats) -> Floats:
        """Return z with 0 in place of values without effect: later values of `Once` channels."""
        counted = z.copy()
        counted[1:, self.once] = 0.0
        return counted

    def in_words(self) -> str:
        """Return the shape in words."""
        return "a shape for each channel; an event is 1 while it lasts"


NoiseShape = Shape | PerChannel
"""Shapes of the noise of an episode."""
