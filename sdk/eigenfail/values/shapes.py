"""Shapes of the noise: how the standardised noise u follows from z.

z is independent and standard normal. A shape is a frozen struct that TOML and JSON name by its
`kind`, and gives u_t from z_t and u_{t-1} (`step`), the inverse (`step_back`), and the slope
(`log_slopes`). Every u_t of a continuous shape has mean 0 and variance 1, so that sigma means the
same under every shape; u_t of an event is 1 while it lasts, and else 0.
"""

from functools import lru_cache
from math import inf, log, log1p, sqrt
from typing import Annotated

import msgspec
import numpy as np
from numpy.typing import NDArray

from eigenfail.values.arrays import Floats
from eigenfail.values.student_t import (
    LOG_SQRT_TWO_PI,
    NORMAL,
    log_t_slope,
    map_normal_to_t,
    map_t_to_normal,
)

Pair = tuple[float, float]
"""A longitudinal and a lateral value."""

Row = tuple[float, ...]
"""A value for each channel, at one step."""

Slopes = NDArray[np.float64]

Correlation = Annotated[float, msgspec.Meta(ge=0.0, lt=1.0)]


class White(msgspec.Struct, frozen=True, forbid_unknown_fields=True, tag_field="kind", tag="white"):
    """The paper's noise: normal, and independent at every step. u = z."""

    def step(self, z: Row, _before: Row | None) -> Row:
        """u_t of z_t."""
        return z

    def step_back(self, u: Row, _before: Row | None) -> Row:
        """z_t of u_t."""
        return u

    def log_slopes(self, z: Slopes) -> Slopes:
        """log |du_t / dz_t|, shape (steps, channels)."""
        return np.zeros(z.shape)

    def in_words(self) -> str:
        """What people read."""
        return "white: normal, independent at every step"


class Correlated(
    msgspec.Struct, frozen=True, forbid_unknown_fields=True, tag_field="kind", tag="ar1"
):
    """An autoregressive process of order one on each of two axes, stationary from its first step.

    u_0 = z_0, u_t = phi · u_{t-1} + sqrt(1 - phi²) · z_t (Box and Jenkins, Time Series Analysis,
    section 3.2), so that every u_t is standard normal and those k steps apart correlate by phi^k.

    Attributes:
        longitudinal_correlation: phi between one step and the next; lateral_correlation likewise.
    """

    longitudinal_correlation: Correlation = 0.8
    lateral_correlation: Correlation = 0.8

    def step(self, z: Row, before: Row | None) -> Row:
        """u_t of z_t and u_{t-1}; None stands before the first step."""
        if before is None:
            return z
        (phi_x, phi_y), (new_x, new_y) = self._kept, self._new
        return phi_x * before[0] + new_x * z[0], phi_y * before[1] + new_y * z[1]

    def step_back(self, u: Row, before: Row | None) -> Row:
        """z_t of u_t and u_{t-1}."""
        if before is None:
            return u
        (phi_x, phi_y), (new_x, new_y) = self._kept, self._new
        return (u[0] - phi_x * before[0]) / new_x, (u[1] - phi_y * before[1]) / new_y

    def log_slopes(self, z: Slopes) -> Slopes:
        """log |du_t / dz_t| = log sqrt(1 - phi²) after the first step, shape (steps, 2)."""
        slopes = np.zeros_like(z)
        slopes[1:] = [0.5 * log1p(-phi * phi) for phi in self._kept]
        return slopes

    @property
    def _kept(self) -> Pair:
        return self.longitudinal_correlation, self.lateral_correlation

    @property
    def _new(self) -> Pair:
        phi_x, phi_y = self._kept
        return sqrt((1.0 - phi_x) * (1.0 + phi_x)), sqrt((1.0 - phi_y) * (1.0 + phi_y))

    def in_words(self) -> str:
        """What people read."""
        phi_x, phi_y = self._kept
        by = f"{phi_x:g} (longitudinal) and {phi_y:g} (lateral)"
        return f"ar1: normal, correlated from step to step by {by}"


class HeavyTailed(
    msgspec.Struct, frozen=True, forbid_unknown_fields=True, tag_field="kind", tag="student_t"
):
    """Student's t in unit variance, independent at every step: outliers are part of the sensor.

    u = T⁻¹(Φ(z)) · sqrt((nu - 2) / nu), with T the distribution function for nu degrees of freedom
    (quantile transform: Devroye 1986, Non-Uniform Random Variate Generation, section II.2).

    Attributes:
        degrees_of_freedom: nu; the fewer, the heavier the tails. Kurtosis is finite above 4.
    """

    degrees_of_freedom: Annotated[float, msgspec.Meta(gt=2.0, le=1000.0)] = 5.0

    def step(self, z: Row, _before: Row | None) -> Row:
        """u_t of z_t."""
        nu, unit = self.degrees_of_freedom, self._unit
        return tuple([unit * map_normal_to_t(each, nu) for each in z])

    def step_back(self, u: Row, _before: Row | None) -> Row:
        """z_t of u_t."""
        nu, unit = self.degrees_of_freedom, self._unit
        return tuple([map_t_to_normal(each / unit, nu) for each in u])

    def log_slopes(self, z: Slopes) -> Slopes:
        """log |du_t / dz_t|, shape (steps, channels)."""
        slopes = [log_t_slope(each, self.degrees_of_freedom) for each in z.ravel().tolist()]
        return np.array(slopes).reshape(z.shape) + log(self._unit)

    @property
    def _unit(self) -> float:
        return sqrt((self.degrees_of_freedom - 2.0) / self.degrees_of_freedom)

    def in_words(self) -> str:
        """What people read."""
        nu = self.degrees_of_freedom
        return f"student_t: heavy tails of {nu:g} degrees of freedom, independent at every step"


Shape = White | Correlated | HeavyTailed
"""Shapes of the noise of a position, on both axes."""


class Autoregressive(
    msgspec.Struct, frozen=True, forbid_unknown_fields=True, tag_field="kind", tag="ar1"
):
    """The process of `Correlated` on one channel.

    Attributes:
        correlation: phi between one step and the next.
    """

    correlation: Correlation = 0.8

    def step(self, z: Row, before: Row | None) -> Row:
        """u_t of z_t and u_{t-1}; None stands before the first step."""
        if before is None:
            return z
        phi, new = self.correlation, self._new
        return tuple([phi * last + new * each for each, last in zip(z, before, strict=True)])

    def step_back(self, u: Row, before: Row | None) -> Row:
        """z_t of u_t and u_{t-1}."""
        if before is None:
            return u
        phi, new = self.correlation, self._new
        return tuple([(each - phi * last) / new for each, last in zip(u, before, strict=True)])

    def log_slopes(self, z: Slopes) -> Slopes:
        """log |du_t / dz_t| = log sqrt(1 - phi²) after the first step, shape (steps, channels)."""
        slopes = np.zeros_like(z)
        slopes[1:] = log(self._new)
        return slopes

    @property
    def _new(self) -> float:
        return sqrt((1.0 - self.correlation) * (1.0 + self.correlation))

    def in_words(self) -> str:
        """What people read."""
        return f"ar1: normal, correlated from step to step by {self.correlation:g}"


class Markov(
    msgspec.Struct, frozen=True, forbid_unknown_fields=True, tag_field="kind", tag="markov"
):
    """An event that begins and ends: a stationary Markov chain of two states (Norris 1997, 1.1).

    u_t = 1, the event lasts, where z_t > Phi⁻¹(1 - P(u_t = 1 | u_{t-1})), else 0. So u is
    distributed as the chain is, and a larger z makes the event more likely, whatever was before.

    Attributes:
        rate: probability that the event begins at a step before which it was absent.
        mean_steps: mean number of steps that it lasts.
    """

    rate: Annotated[float, msgspec.Meta(gt=0.0, le=0.5)] = 0.01
    mean_steps: Annotated[float, msgspec.Meta(ge=1.0, le=1000.0)] = 5.0

    def step(self, z: Row, before: Row | None) -> Row:
        """u_t of z_t and u_{t-1}; None stands before the first step."""
        likely = self._probabilities(len(z), before)
        pairs = zip(z, likely, strict=True)
        return tuple([1.0 if each > _find_threshold(p) else 0.0 for each, p in pairs])

    def step_back(self, u: Row, before: Row | None) -> Row:
        """The mean of z_t where u_t, rounded to an event or none, follows u_{t-1}."""
        likely = self._probabilities(len(u), before)
        return tuple([_find_mean_z(each, p) for each, p in zip(u, likely, strict=True)])

    def log_slopes(self, z: Slopes) -> Slopes:
        """log of the density of z_t ÷ P(u_t | u_{t-1}), shape (steps, channels).

        The counterpart of log |du_t / dz_t| for an event: what the log density of z exceeds the log
        probability of u by.
        """
        slopes, before = [], None
        for row in z.tolist():
            u = self.step(tuple(row), before)
            likely = self._probabilities(len(u), before)
            masses = [p if each else 1.0 - p for each, p in zip(u, likely, strict=True)]
            slopes.append([-0.5 * at * at - log(m) for at, m in zip(row, masses, strict=True)])
            before = u
        return np.array(slopes).reshape(z.shape) - LOG_SQRT_TWO_PI

    def mean_log_probabilities(self) -> tuple[float, float]:
        """Mean of log P(u_t | u_{t-1}) under the chain: at the first step, and at a later one."""
        share, ends = self._share, 1.0 / self.mean_steps
        stays, begins = _negative_entropy(1.0 - ends), _negative_entropy(self.rate)
        return _negative_entropy(share), share * stays + (1.0 - share) * begins

    @property
    def _share(self) -> float:
        """Share of the steps at which the event lasts."""
        return self.rate / (self.rate + 1.0 / self.mean_steps)

    def _probabilities(self, channels: int, before: Row | None) -> Row:
        """P(u_t = 1 | u_{t-1}) of each channel; at the first step the stationary probability."""
        if before is None:
            return (self._share,) * channels
        ends = 1.0 / self.mean_steps
        return tuple([1.0 - ends if last >= 0.5 else self.rate for last in before])

    def in_words(self) -> str:
        """What people read."""
        return (
            f"markov: begins with probability {self.rate:g} a step, lasts {self.mean_steps:g} "
            "steps on average"
        )


def _negative_entropy(p: float) -> float:
    """p log p + (1 - p) log(1 - p), which is 0 at both ends."""
    return sum(each * log(each) for each in (p, 1.0 - p) if each > 0.0)


@lru_cache(maxsize=64)
def _find_threshold(probability: float) -> float:
    """Return the value that a standard normal variable exceeds with that probability."""
    return -NORMAL.inv_cdf(probability) if probability > 0.0 else inf


def _find_mean_z(u: float, probability: float) -> float:
    """Return the mean of a standard normal z above its threshold, or below it where u < 0.5."""
    if probability == 0.0:
        return 0.0
    density = NORMAL.pdf(_find_threshold(probability))
    return density / probability if u >= 0.5 else -density / (1.0 - probability)


class Once(msgspec.Struct, frozen=True, forbid_unknown_fields=True, tag_field="kind", tag="once"):
    """One draw for the whole episode: u_t = z_0. Later z are without effect."""

    def step(self, z: Row, before: Row | None) -> Row:
        """u_t of z_t and u_{t-1}; None stands before the first step."""
        return z if before is None else before

    def step_back(self, u: Row, before: Row | None) -> Row:
        """z_t of u_t and u_{t-1}: of the values that z_t may have after the first step, 0."""
        return u if before is None else (0.0,) * len(u)

    def log_slopes(self, z: Slopes) -> Slopes:
        """log of the density of z_t ÷ that of u_t | u_{t-1}, shape (steps, channels).

        After the first step nothing is random, so that the density of z alone remains.
        """
        slopes = np.zeros_like(z)
        slopes[1:] = -0.5 * z[1:] ** 2 - LOG_SQRT_TWO_PI
        return slopes

    def in_words(self) -> str:
        """What people read."""
        return "drawn once an episode"


ChannelShape = White | Autoregressive | HeavyTailed | Markov | Once
"""Shapes of the noise of one channel."""


class PerChannel(
    msgspec.Struct, frozen=True, forbid_unknown_fields=True, tag_field="kind", tag="per_channel"
):
    """A shape for each channel, in the order of the columns of z."""

    shapes: tuple[ChannelShape, ...]

    def step(self, z: Row, before: Row | None) -> Row:
        """u_t of z_t and u_{t-1}; None stands before the first step."""
        return tuple(
            [
                shape.step((z[way],), None if before is None else (before[way],))[0]
                for way, shape in enumerate(self.shapes)
            ]
        )

    def step_back(self, u: Row, before: Row | None) -> Row:
        """z_t of u_t and u_{t-1}."""
        return tuple(
            [
                shape.step_back((u[way],), None if before is None else (before[way],))[0]
                for way, shape in enumerate(self.shapes)
            ]
        )

    def log_slopes(self, z: Slopes) -> Slopes:
        """log |du_t / dz_t|, or what `Markov.log_slopes` is, shape (steps, channels)."""
        columns = [shape.log_slopes(z[:, [way]]) for way, shape in enumerate(self.shapes)]
        return np.concatenate(columns, axis=1)

    @property
    def once(self) -> list[int]:
        """Columns of what is drawn once."""
        return [way for way, shape in enumerate(self.shapes) if isinstance(shape, Once)]

    def drop_uncounted(self, z: Floats) -> Floats:
        """z with 0 in place of the values without effect: the later ones of what is drawn once."""
        counted = z.copy()
        counted[1:, self.once] = 0.0
        return counted

    def in_words(self) -> str:
        """What people read."""
        return "a shape for each channel; an event is 1 while it lasts"


NoiseShape = Shape | PerChannel
"""Shapes of the noise of an episode."""
