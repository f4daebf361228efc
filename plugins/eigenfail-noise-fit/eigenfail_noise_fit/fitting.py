"""Fits of the errors of channels to a log, one for each shape of the noise.

If a log has only position errors, both axes share one kind of shape, as in `DisturbanceModel`;
otherwise each channel has its own shape.
"""

from collections.abc import Callable, Sequence
from functools import partial
from math import lgamma, log, pi, sqrt
from typing import NamedTuple

import msgspec
import numpy as np
from scipy import special

from eigenfail.values.channels import QUANTITIES, Channel
from eigenfail.values.disturbance import DisturbanceModel
from eigenfail.values.shapes import (
    Autoregressive,
    ChannelShape,
    Correlated,
    HeavyTailed,
    Shape,
    White,
)
from eigenfail_noise_fit import jackknife
from eigenfail_noise_fit.sensor_log import ErrorSeries

MOST_CORRELATION = 0.999
LEAST_FREEDOM, MOST_FREEDOM = 2.05, 1000.0
LEAST_BASE, MOST_BASE = 1e-4, 100.0
MOST_SLOPE = 1.0

UNITS = {"rad": 0.01}
"""What errors are divided by while their sigma is searched for, so that it is of the order of 1."""

UNDETERMINED = (
    "its distances do not tell how errors grow with them.",
    "Log vehicles at different distances along the road, and in other lanes.",
)


class Candidate(NamedTuple):
    """A shape of the noise with its parameters, after the slopes and bases.

    Attributes:
        kind: its name.
        own: names, bounds and start of the shape's own parameters, for some channels.
        find_density: log density of each measurement's u, shape (n,), from the errors, the
            standardised errors u, shape (n, channels), and the shape's own parameters.
        find_z: z of each measurement, shape (n, channels), from the same.
        make_shape: the shape of one channel from its own parameters.
        make_joint_shape: the shape of both axes of a position.
    """

    kind: str
    own: Callable[[tuple[str, ...]], tuple[jackknife.FreeParameter, ...]]
    find_density: Callable[[ErrorSeries, jackknife.Array, jackknife.Array], jackknife.Array]
    find_z: Callable[[ErrorSeries, jackknife.Array, jackknife.Array], jackknife.Array]
    make_shape: Callable[..., ChannelShape]
    make_joint_shape: Callable[..., Shape]


def find_white_z(
    _errors: ErrorSeries, u: jackknife.Array, _own: jackknife.Array
) -> jackknife.Array:
    """Return u, which is z."""
    return u


def find_white_density(
    _errors: ErrorSeries, u: jackknife.Array, _own: jackknife.Array
) -> jackknife.Array:
    """Log N(u; 0, 1)."""
    return _log_normal_density(u)


def find_correlated_z(
    errors: ErrorSeries, u: jackknife.Array, phi: jackknife.Array
) -> jackknife.Array:
    """z_t = (u_t − phi · u_{t−1}) / sqrt(1 − phi²); u_t if the previous step was missed."""
    expected = np.where(errors.follows[:, None], phi * np.roll(u, 1, axis=0), 0.0)
    z: jackknife.Array = (u - expected) / _find_new_spread(errors, phi)
    return z


def find_correlated_density(
    errors: ErrorSeries, u: jackknife.Array, phi: jackknife.Array
) -> jackknife.Array:
    """Log N(u_t; phi · u_{t−1}, 1 − phi²); log N(u_t; 0, 1) if the previous step was missed."""
    spread = np.log(_find_new_spread(errors, phi)).sum(axis=1)
    density: jackknife.Array = _log_normal_density(find_correlated_z(errors, u, phi)) - spread
    return density


def _find_new_spread(errors: ErrorSeries, phi: jackknife.Array) -> jackknife.Array:
    """Return the standard deviation of u_t given the step before, shape (n, channels)."""
    spread: jackknife.Array = np.where(errors.follows[:, None], np.sqrt(1.0 - phi**2), 1.0)
    return spread


def find_heavy_tailed_z(
    _errors: ErrorSeries, u: jackknife.Array, inverse_freedom: jackknife.Array
) -> jackknife.Array:
    """Z = Φ⁻¹(T(t)), t = u / sqrt((nu − 2) / nu)."""
    nu = 1.0 / float(inverse_freedom[0])
    t = u / sqrt((nu - 2.0) / nu)
    tail = special.stdtr(nu, -np.abs(t))
    z: jackknife.Array = -np.sign(t) * special.ndtri(np.maximum(tail, np.finfo(float).tiny))
    return z


def find_heavy_tailed_density(
    _errors: ErrorSeries, u: jackknife.Array, inverse_freedom: jackknife.Array
) -> jackknife.Array:
    """Log density of Student's t in unit variance (Abramowitz and Stegun, 26.7.1)."""
    nu = 1.0 / float(inverse_freedom[0])
    norm = lgamma(0.5 * (nu + 1.0)) - lgamma(0.5 * nu) - 0.5 * log((nu - 2.0) * pi)
    density: jackknife.Array = (norm - 0.5 * (nu + 1.0) * np.log1p(u * u / (nu - 2.0))).sum(axis=1)
    return density


def _log_normal_density(z: jackknife.Array) -> jackknife.Array:
    density: jackknife.Array = -0.5 * np.square(z).sum(axis=1) - 0.5 * z.shape[1] * log(2.0 * pi)
    return density


def _list_no_parameters(_channels: tuple[str, ...]) -> tuple[jackknife.FreeParameter, ...]:
    return ()


def _list_correlations(channels: tuple[str, ...]) -> tuple[jackknife.FreeParameter, ...]:
    joint = len(channels) > 1
    return tuple(
        jackknife.FreeParameter(
            f"{name}_correlation" if joint else f"{name}.correlation",
            (0.0, MOST_CORRELATION),
            0.5,
        )
        for name in channels
    )


def _list_freedom(channels: tuple[str, ...]) -> tuple[jackknife.FreeParameter, ...]:
    name = "degrees_of_freedom" if len(channels) > 1 else f"{channels[0]}.degrees_of_freedom"
    return (
        jackknife.FreeParameter(
            name, (1.0 / MOST_FREEDOM, 1.0 / LEAST_FREEDOM), 0.2, is_inverse=True
        ),
    )


def _make_heavy_tailed(inverse_freedom: float) -> HeavyTailed:
    return HeavyTailed(1.0 / inverse_freedom)


CANDIDATES = (
    Candidate("white", _list_no_parameters, find_white_density, find_white_z, White, White),
    Candidate(
        "ar1",
        _list_correlations,
        find_correlated_density,
        find_correlated_z,
        Autoregressive,
        Correlated,
    ),
    Candidate(
        "student_t",
        _list_freedom,
        find_heavy_tailed_density,
        find_heavy_tailed_z,
        _make_heavy_tailed,
        _make_heavy_tailed,
    ),
)


class Fit(msgspec.Struct, frozen=True, eq=False):
    """The best parameters of one shape.

    Attributes:
        candidate: the shape.
        channels: the channels that have it.
        best: parameters of largest likelihood: slope and base of each channel, then the shape's
            own.
        score: log density on tracks that were not fitted, and its gain over white noise.
    """

    candidate: Candidate
    channels: tuple[str, ...]
    best: jackknife.Array
    score: jackknife.ShapeScore

    @property
    def model(self) -> DisturbanceModel:
        """The disturbance model of a position with the fitted parameters."""
        shape = self.candidate.make_joint_shape(*self._own.tolist())
        along, along_base, across, across_base = self.best[:4].tolist()
        return DisturbanceModel(along, along_base, across, across_base, shape=shape)

    @property
    def channel(self) -> Channel:
        """The only channel with the fitted parameters."""
        (name,), (slope, base) = self.channels, self.best[:2].tolist()
        return Channel(name, base, slope, self.candidate.make_shape(*self._own.tolist()))

    @property
    def _own(self) -> jackknife.Array:
        return self.best[2 * len(self.channels) :]

    def find_z(self, errors: ErrorSeries) -> jackknife.Array:
        """Return z of the errors, shape (n, channels): standard normal if the model holds."""
        u = errors.error / compute_sigma(errors, self.best)
        return self.candidate.find_z(errors, u, self._own)


def fit_shapes(errors: ErrorSeries) -> list[Fit]:
    """Return the fits of all shapes; white noise is the first."""
    likelihoods = [make_likelihood(candidate, errors) for candidate in CANDIDATES]
    scores = jackknife.compare_candidates(likelihoods)
    return [
        Fit(candidate, errors.channels, jackknife.maximize_likelihood(likelihood), score)
        for candidate, likelihood, score in zip(CANDIDATES, likelihoods, scores, strict=True)
    ]


def choose_fit(fits: Sequence[Fit]) -> Fit:
    """Return the fit with the largest density on tracks that were held out.

    This is white noise, the simplest fit, unless another fit has a gain over white noise with an
    interval above 0.
    """
    better = [fit for fit in fits if fit.score.is_better]
    return max(better, key=lambda fit: fit.score.held_out, default=fits[0])


def find_parameters(fit: Fit, errors: ErrorSeries) -> tuple[jackknife.Parameter, ...]:
    """Return the parameters of a fit with the intervals of the jackknife over tracks.

    Raises:
        InvalidValue: the log does not determine all parameters.
    """
    return jackknife.estimate_parameters(make_likelihood(fit.candidate, errors), fit.best)


def make_likelihood(candidate: Candidate, errors: ErrorSeries) -> jackknife.Likelihood:
    """Return the likelihood of the errors under a shape: slopes and bases, then the shape's own."""
    return jackknife.Likelihood(
        (*_list_sigmas(errors), *candidate.own(errors.channels)),
        partial(compute_density, candidate, errors),
        errors.track,
        errors.tracks,
        UNDETERMINED,
    )


def _list_sigmas(errors: ErrorSeries) -> list[jackknife.FreeParameter]:
    """Return the slope and the base of each channel, by their names in the model."""
    spread = np.sqrt(np.mean(np.square(errors.error), axis=0))
    joint = len(errors.channels) > 1
    listed = []
    for name, sigma in zip(errors.channels, spread.tolist(), strict=True):
        unit = UNITS.get(QUANTITIES[name].unit, 1.0)
        slope, base = f"{name}.sigma_per_m", f"{name}.sigma"
        if joint:
            slope, base = f"{name}_slope", f"{name}_base_m"
        start = float(np.clip(sigma, 1e-3 * unit, MOST_BASE))
        listed += [
            jackknife.FreeParameter(slope, (0.0, MOST_SLOPE), 0.0, unit, least_scale=1e-2 * unit),
            # Of a scale the logarithm is nearer to normal than the scale itself.
            jackknife.FreeParameter(
                base,
                (LEAST_BASE * unit, MOST_BASE),
                start,
                unit,
                is_scale=True,
                least_scale=1e-2 * unit,
            ),
        ]
    return listed


def compute_density(
    candidate: Candidate, errors: ErrorSeries, parameters: jackknife.Array
) -> jackknife.Array:
    """Return the log density of each measurement's errors under some parameters, shape (n,)."""
    sigma = compute_sigma(errors, parameters)
    own = parameters[2 * len(errors.channels) :]
    found = candidate.find_density(errors, errors.error / sigma, own)
    density: jackknife.Array = found - np.log(sigma).sum(axis=1)
    return density


def compute_sigma(errors: ErrorSeries, parameters: jackknife.Array) -> jackknife.Array:
    """Return sigma of each measurement, shape (n, channels), in the units of the errors."""
    count = 2 * len(errors.channels)
    sigma: jackknife.Array = parameters[0:count:2] * errors.distance_m + parameters[1:count:2]
    return sigma
