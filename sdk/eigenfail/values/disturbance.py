"""The disturbance model p(x), its conversion to injected errors, and noise trajectories."""

from collections.abc import Callable, Iterator, Sequence
from functools import cached_property
from itertools import groupby
from math import isfinite
from typing import Annotated

import msgspec
import numpy as np
from msgspec.structs import replace
from numpy.typing import NDArray

from eigenfail.errors import InvalidValue, UnknownName
from eigenfail.values.arrays import LARGEST_FLOAT32, Floats, find_lost
from eigenfail.values.channels import (
    MOST_CHANNELS,
    SCENARIO,
    Channel,
    name_columns,
    resolve_channels,
    split_name,
    write_out,
)
from eigenfail.values.shapes import NoiseShape, PerChannel, Row, Shape, White
from eigenfail.values.showing import Brief
from eigenfail.values.student_t import LOG_SQRT_TWO_PI
from eigenfail.values.variation import make_correlation_matrix

AXES = ("longitudinal", "lateral")
"""The channels of a campaign on a road that names none: the components of the noise of the position
of the nearest vehicle. z has a column for each channel, in this order."""


SMALLEST_EIGENVALUE = 1e-9
"""Smallest eigenvalue of an accepted correlation matrix: its Cholesky factor exists in doubles."""


class ScenarioCorrelation(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Correlation of two channels of scenario parameters, by a Gaussian copula.

    The z of both channels stay independent. From them follow two standard normal values with this
    correlation; each parameter is the quantile at Phi of its value.

    Attributes:
        channels: names of the two channels.
        coefficient: correlation of the two standard normal values.
    """

    channels: tuple[str, str]
    coefficient: Annotated[float, msgspec.Meta(gt=-1.0, lt=1.0)]


CORRELATIONS_FIELD = "disturbance.correlations"


class DisturbanceModel(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The disturbance model a_t = sigma_t · u_t; sigma grows with distance (paper, eq. 2 and 3).

    sigma_x = scale · (longitudinal_slope · |dx| + longitudinal_base_m), and the same for y. [m]

    u = shape(z), with z independent and standard normal. With the default shape, u = z: the
    paper's a_t ~ N(0, diag(sigma_x², sigma_y²)).

    Attributes:
        scale: factor of every sigma; measures the margin of a sensor's specification.
        shape: function that makes the standardised noise u, with unit variance, from z.
        channels: all channels of the noise. They replace the two position channels of the nearest
            vehicle, which the slopes, bases and shape describe.
        correlations: correlations between channels of scenario parameters; all others are
            independent.
        occlusion: whether vehicles that others hide from the ego are not detected.
    """

    longitudinal_slope: Annotated[float, msgspec.Meta(ge=0.0, le=1.0)] = 0.02
    longitudinal_base_m: Annotated[float, msgspec.Meta(gt=0.0, le=100.0)] = 1.0
    lateral_slope: Annotated[float, msgspec.Meta(ge=0.0, le=1.0)] = 0.00625
    lateral_base_m: Annotated[float, msgspec.Meta(gt=0.0, le=100.0)] = 0.2
    scale: Annotated[float, msgspec.Meta(gt=0.0, le=10.0)] = 1.0
    shape: Shape = White()
    # Where it is not given it is absent from texts, keys and digests: they stay as they were before
    # there was such a field.
    channels: (
        Annotated[tuple[Channel, ...], msgspec.Meta(min_length=1, max_length=MOST_CHANNELS)]
        | msgspec.UnsetType
    ) = msgspec.UNSET
    correlations: (
        Annotated[tuple[ScenarioCorrelation, ...], msgspec.Meta(min_length=1, max_length=100)]
        | msgspec.UnsetType
    ) = msgspec.UNSET
    occlusion: bool | msgspec.UnsetType = msgspec.UNSET

    @property
    def is_occluding(self) -> bool:
        """True if vehicles that others hide from the ego are not detected."""
        return self.occlusion is True

    def list_channels(self) -> tuple[Channel, ...]:
        """Return the channels of the noise, in the order of the columns of z."""
        if not isinstance(self.channels, msgspec.UnsetType):
            return tuple(channel.filled() for channel in self.channels)
        # The fields of a position are these two channels, written as before there were channels.
        along = Channel(AXES[0], self.longitudinal_base_m, self.longitudinal_slope)
        return along, Channel(AXES[1], self.lateral_base_m, self.lateral_slope)

    @property
    def noise_shape(self) -> NoiseShape:
        """The shape of the noise on all channels."""
        if isinstance(self.channels, msgspec.UnsetType):
            return self.shape
        shapes = tuple(channel.shape or White() for channel in self.list_channels())
        # One shape for all columns computes them at once; a shape for each takes a call for each.
        return White() if set(shapes) == {White()} else PerChannel(shapes)

    @property
    def searched_parameters(self) -> tuple[str, ...]:
        """Names of the scenario parameters that channels make a part of the search."""
        names = map(split_name, (channel.name for channel in self.list_channels()))
        return tuple(quantity for target, quantity in names if target == SCENARIO)

    @property
    def parameter_correlations(self) -> dict[tuple[str, str], float]:
        """The coefficients between parameters of the scenario, by the names of both."""
        if isinstance(self.correlations, msgspec.UnsetType):
            return {}
        pairs = ((each.channels, each.coefficient) for each in self.correlations)
        return {
            (split_name(one).quantity, split_name(other).quantity): value
            for (one, other), value in pairs
        }

    def check_correlations(self) -> None:
        """Check that correlations are between channels of scenario parameters, and possible.

        Raises:
            UnknownName: a correlation names a channel that is not a channel of a scenario
                parameter.
            InvalidValue: a correlation names a channel twice or repeats a pair, or the matrix of
                all correlations is not positive definite.
        """
        if isinstance(self.correlations, msgspec.UnsetType):
            return
        known = tuple(f"{SCENARIO}.{name}" for name in self.searched_parameters)
        pairs: list[frozenset[str]] = []
        for place, each in enumerate(self.correlations):
            field, pair = f"{CORRELATIONS_FIELD}[{place}].channels", frozenset(each.channels)
            if unknown := [name for name in each.channels if name not in known]:
                raise UnknownName(field, unknown[0], known)
            if len(pair) == 1 or pair in pairs:
                problem = f"{' and '.join(each.channels)} cannot be correlated here."
                raise InvalidValue(field, problem, "Name two channels, and each pair once.")
            pairs.append(pair)
        parameters = self.searched_parameters
        matrix = make_correlation_matrix(parameters, self.parameter_correlations)
        # Not by trying a Cholesky factor: its error would not say how far off the matrix is.
        smallest = float(np.linalg.eigvalsh(matrix)[0])
        if smallest < SMALLEST_EIGENVALUE:
            raise InvalidValue(
                CORRELATIONS_FIELD,
                f"the matrix of the coefficients of {', '.join(parameters)} is not positive "
                f"definite: its smallest eigenvalue is {smallest:.3g}.",
                "Take coefficients nearer to 0, or give the missing pairs one.",
            )

    def resolve(
        self, vehicles: int, offered: frozenset[str], parameters: Sequence[str] = ()
    ) -> "DisturbanceModel":
        """Return the model with its channels written out; see `resolve_channels`.

        Raises:
            UnknownName: a channel does not exist; the error lists the known ones.
            InvalidValue: a channel's model is invalid, or slopes, bases or shape are set, too.
        """
        if isinstance(self.channels, msgspec.UnsetType):
            return self
        # `scale` and `occlusion` apply to named channels, too: only the rest must be the default.
        plain = DisturbanceModel(
            self.longitudinal_slope,
            self.longitudinal_base_m,
            self.lateral_slope,
            self.lateral_base_m,
            shape=self.shape,
        )
        if plain != DisturbanceModel():
            raise InvalidValue(
                "disturbance",
                "slopes, bases and shape of the position do not apply where channels are named.",
                "Set sigma, sigma_per_m and shape of each channel instead.",
            )
        return replace(
            self, channels=resolve_channels(self.channels, vehicles, offered, parameters)
        )

    def is_like(self, other: "DisturbanceModel") -> bool:
        """Return whether both models are the same once their channels are written out."""
        numbers = [
            split_name(channel.name).vehicle or 1
            for model in (self, other)
            for channel in model.list_channels()
        ]
        mine, theirs = (
            # For as many vehicles as either of them names.
            replace(model.write_out(max(numbers)), occlusion=model.is_occluding)
            for model in (self, other)
        )
        return mine == theirs

    def write_out(self, vehicles: int) -> "DisturbanceModel":
        """Return the model with its channels written out, without checking them."""
        if isinstance(self.channels, msgspec.UnsetType):
            return self
        return replace(self, channels=write_out(self.channels, vehicles))

    def in_words(self) -> dict[str, str]:
        """Return the model in words, by name of the channel or setting."""
        occlusion = {"occlusion": "vehicles that others hide are not detected"}
        correlations = {
            f"correlation of {one} and {other}": f"{value:g}"
            for (one, other), value in self.parameter_correlations.items()
        }
        return {
            **self._describe_errors(),
            **correlations,
            **(occlusion if self.is_occluding else {}),
        }

    def _describe_errors(self) -> dict[str, str]:
        if not isinstance(self.channels, msgspec.UnsetType):
            words = {channel.name: channel.in_words() for channel in self.list_channels()}
            return {**words, "scale": f"every sigma × {self.scale:g}"}
        along, across = self.longitudinal_base_m, self.lateral_base_m
        return {
            "longitudinal sigma": f"{self.longitudinal_slope:g}·|dx| + {along:g} m",
            "lateral sigma": f"{self.lateral_slope:g}·|dy| + {across:g} m",
            "scale": f"both sigmas × {self.scale:g}",
            "shape": self.shape.in_words(),
        }


POSITION = DisturbanceModel().list_channels()
"""The channels of `AXES`, under the paper's model."""


class Conversion:
    """Converter between z and injected errors of one episode, step by step from its start.

    On a road, if another vehicle becomes the nearest one, the noise of the nearest vehicle's
    channels continues.
    """

    def __init__(self, shape: NoiseShape) -> None:
        self._shape = shape
        self._rated = frozenset(shape.rated) if isinstance(shape, PerChannel) else frozenset()
        self._before: Row | None = None

    def inject(self, z: Row, sigma: Row) -> Row:
        """Return the errors a_t = sigma_t · u_t; on a road, in the units of the channels."""
        u = self.standardise(z, sigma)
        return tuple([each * at for each, at in zip(u, self._get_scales(sigma), strict=True)])

    def standardise(self, z: Row, sigma: Row) -> Row:
        """Return u_t from z_t."""
        self._before = self._shape.step(z, self._before, sigma)
        return self._before

    def to_z(self, a: Row, sigma: Row) -> Row:
        """Return z_t from the errors that were injected at that sigma."""
        u = tuple([each / at for each, at in zip(a, self._get_scales(sigma), strict=True)])
        z = self._shape.step_back(u, self._before, sigma)
        self._before = u
        return z

    def _get_scales(self, sigma: Row) -> Row:
        """Return the factors of u_t: 1 if sigma holds the probability of an event."""
        if not self._rated:
            return sigma
        return tuple([1.0 if way in self._rated else each for way, each in enumerate(sigma)])


Doubles = NDArray[np.float64]

TRAJECTORIES_AT_A_TIME = 32
"""Number of trajectories whose densities are computed together: with more it takes longer, as their
doubles stay in the cache of the processor."""


class NoiseTrajectory(Brief, msgspec.Struct, frozen=True, eq=False, dict=True):
    """The disturbances of one episode, step by step, up to its end.

    Attributes:
        z: the standard normal draws behind the noise, shape (steps, channels).
        sigma: standard deviations at each step, in the units of the channels, shape (steps,
            channels). For an event: 1, or the probability that the event begins if the probability
            depends on the distance.
        shape: how the noise follows from z.
    """

    z: Floats
    sigma: Floats
    shape: NoiseShape = White()

    @classmethod
    def from_injected(
        cls, injected: Doubles, sigma: Floats, shape: NoiseShape
    ) -> "NoiseTrajectory":
        """Return the noise whose errors are `injected`, to the precision of float32.

        Args:
            injected: errors, shape (steps, channels).
            sigma: standard deviations, as in the attributes.
            shape: how the noise follows from z.

        Raises:
            InvalidValue: the noise would be beyond the range of float32.
        """
        z = _convert(Conversion(shape).to_z, injected, sigma)
        # Refused before the conversion, which would make infinity of it without a word.
        if (lost := find_lost(z)) is not None:
            problem = f"noise of {lost:g} sigma is beyond ±{LARGEST_FLOAT32:g}."
            raise InvalidValue("injected", problem, "Look at the recorded disturbances and sigma.")
        return cls(z.astype(np.float32), sigma, shape)

    @cached_property
    def injected(self) -> Doubles:
        """The disturbances a_t of the perception, shape (steps, channels), in their units."""
        return _convert(Conversion(self.shape).inject, self.z, self.sigma)

    @cached_property
    def standardised(self) -> Doubles:
        """u_t, shape (steps, channels); mean 0 and variance 1 in a continuous channel."""
        return _convert(Conversion(self.shape).standardise, self.z, self.sigma)

    @property
    def counted_z(self) -> Floats:
        """z with 0 in place of values without effect."""
        shape = self.shape
        return shape.drop_uncounted(self.z) if isinstance(shape, PerChannel) else self.z

    @cached_property
    def log_probability(self) -> float:
        """log p(a_1 … a_T): the sum over the steps until the episode ended."""
        return sum_log_densities([self])[0]

    @cached_property
    def log_probability_per_step(self) -> Doubles:
        """log p(a_t | a_1 … a_{t-1}) of every step, shape (steps,); a in the channels' units.

        The sum over the channels of log N(z_t) - log sigma_t - log |du_t/dz_t|: a change of
        variables whose Jacobian is triangular, since u_t does not depend on later z. For a channel
        of events: the log probability of the outcome at t.
        """
        return _find_log_densities([self])


def list_noise(noise: NoiseTrajectory, channels: Sequence[str]) -> Iterator[dict[str, float]]:
    """Yield a row for each step of the noise, with columns for each of the named channels."""
    columns = [name_columns(name) for name in channels]
    # As floats of Python: numpy's are not written by every encoder of JSON and CSV.
    rows = zip(noise.injected, noise.z, noise.sigma, strict=True)
    for step, (injected, z, sigma) in enumerate(rows):
        row: dict[str, float] = {"step": step}
        for names, a_t, z_t, sigma_t in zip(columns, injected, z, sigma, strict=True):
            row |= {names.error: float(a_t), names.z: float(z_t), names.sigma: float(sigma_t)}
        yield row


class ChannelLikelihood(msgspec.Struct, frozen=True):
    """How likely the noise of one channel was, over the steps of an episode.

    Attributes:
        name: name of the channel.
        log_probability: part of the channel in log p, in the unit of the channel; for an event, the
            log probability of the outcomes. null if the recorded noise does not have a density.
        relative: -1/2 of the sum of z²: log density of z minus the log density of z = 0, the most
            likely value. It does not depend on the channel's unit and shape; null if it is not
            finite.
    """

    name: str
    log_probability: float | None
    relative: float | None


def find_channel_likelihoods(
    noise: NoiseTrajectory, channels: Sequence[str]
) -> tuple[ChannelLikelihood, ...]:
    """Return how likely the noise of each channel was; empty for noise without a step."""
    if not len(noise.z):
        return ()
    parts = _find_channel_densities([noise]).sum(axis=0).tolist()
    energies = np.sum(noise.counted_z.astype(np.float64) ** 2, axis=0).tolist()
    return tuple(
        ChannelLikelihood(name, _keep_finite(part), _keep_finite(0.0 - 0.5 * energy))
        for name, part, energy in zip(channels, parts, energies, strict=True)
    )


def _keep_finite(value: float) -> float | None:
    return value if isfinite(value) else None


def sum_log_densities(trajectories: Sequence[NoiseTrajectory]) -> list[float]:
    """Return the `log_probability` of each trajectory; all have the same number of channels.

    The values at each step are not kept: a hub holds thousands of results, and only needs sums.
    """
    sums: list[float] = []
    for first in range(0, len(trajectories), TRAJECTORIES_AT_A_TIME):
        some = trajectories[first : first + TRAJECTORIES_AT_A_TIME]
        densities, end = _find_log_densities(some), 0
        # Most last as long as the one before: rows of one array are summed several times faster.
        for length, alike in groupby(len(each.z) for each in some):
            count = sum(1 for _ in alike)
            first_step, end = end, end + count * length
            sums += densities[first_step:end].reshape(count, length).sum(axis=1).tolist()
    return sums


def _find_log_densities(trajectories: Sequence[NoiseTrajectory]) -> Doubles:
    """Return log p of every step of the trajectories in sequence, shape (all steps,)."""
    density = _find_channel_densities(trajectories)
    # Two channels are the usual case, for which numpy's sum takes ten times as long.
    if density.shape[1] == len(AXES):
        pairs: Doubles = density[:, 0] + density[:, 1]
        return pairs
    total: Doubles = density.sum(axis=1)
    return total


def _find_channel_densities(trajectories: Sequence[NoiseTrajectory]) -> Doubles:
    """Return log p of every step on each channel, shape (all steps, channels)."""
    z = np.concatenate([each.z for each in trajectories], dtype=np.float64)
    scales = [_get_scales(each) for each in trajectories]
    sigma = np.concatenate(scales, dtype=np.float64)
    density: Doubles = -0.5 * z**2 - np.log(sigma) - LOG_SQRT_TWO_PI
    end = 0
    for each in trajectories:
        begin, end = end, end + len(each.z)
        if each.shape != White():  # which has slopes of 1
            density[begin:end] -= each.shape.log_slopes(z[begin:end], each.sigma)
        if isinstance(each.shape, PerChannel):
            # What is drawn once has one density, whatever its unit.
            density[begin + 1 : end, each.shape.once] += np.log(
                sigma[begin + 1 : end, each.shape.once]
            )
    return density


def _get_scales(noise: NoiseTrajectory) -> Floats:
    """Return the sigma of noise, with 1 in place of the probabilities of events."""
    if not isinstance(noise.shape, PerChannel) or not (rated := noise.shape.rated):
        return noise.sigma
    scales = noise.sigma.copy()
    scales[:, list(rated)] = 1.0
    return scales


def _convert(
    step: Callable[[Row, Row], Row], values: NDArray[np.floating], sigma: Floats
) -> Doubles:
    """Return the array with each row taken, with its sigma, through a step of a conversion."""
    rows = zip(values.tolist(), sigma.tolist(), strict=True)
    return np.array([step(value, at) for value, at in rows]).reshape(values.shape)
