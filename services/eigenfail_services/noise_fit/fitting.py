"""Maximum likelihood fits of the disturbance model to a log, one for each shape of the noise.

Measurements of one track depend on each other in ways that no model holds whole, tracks do not: so
intervals come from the jackknife over tracks, and shapes are compared on tracks that they were not
fitted to.
"""

from collections.abc import Callable, Sequence
from math import exp, lgamma, log, pi, sqrt
from typing import NamedTuple

import msgspec
import numpy as np
from scipy import optimize, special, stats

from eigenfail.errors import InvalidValue
from eigenfail.values import Correlated, DisturbanceModel, HeavyTailed, Interval, White
from eigenfail.values.shapes import Shape
from eigenfail_services.noise_fit.sensor_log import Array, SensorLog

FOLDS = 5
CONFIDENCE = 0.95

MOST_CORRELATION = 0.999
LEAST_FREEDOM, MOST_FREEDOM = 2.05, 1000.0
LEAST_BASE_M, MOST_BASE_M = 1e-4, 100.0

DIFFERENCE = 1e-4
"""Step of a numerical derivative, as a share of the parameter or of 1e-2, whichever is larger."""

WORST_CONDITION = 1e6
"""Largest condition of the scaled curvature of the likelihood. Beyond it rounding errors of the
numerical derivatives decide, as where distances hardly differ and only sigma as a whole is told."""

MOST_SPREADS = 50.0
"""Most widths of its interval, as logarithms, by which a base may be wrong."""

SLOPES_AND_BASES = (
    "longitudinal_slope",
    "longitudinal_base_m",
    "lateral_slope",
    "lateral_base_m",
)
BOUNDS = ((0.0, 1.0), (LEAST_BASE_M, MOST_BASE_M)) * 2


class Candidate(NamedTuple):
    """A shape of the noise with its parameters, after the slopes and bases.

    Attributes:
        names: names of its own parameters.
        start: where the search for them begins.
        bounds: their bounds.
        find_density: log density of each measurement's u, shape (n,), from the log, the
            standardised errors u, shape (n, 2), and the shape's own parameters.
        find_z: z of each measurement, shape (n, 2), from the same.
        make_model: the disturbance model for all parameters.
    """

    kind: str
    names: tuple[str, ...]
    start: tuple[float, ...]
    bounds: tuple[tuple[float, float], ...]
    find_density: Callable[[SensorLog, Array, Array], Array]
    find_z: Callable[[SensorLog, Array, Array], Array]
    make_model: Callable[[Array], DisturbanceModel]


def find_white_z(_log: SensorLog, u: Array, _own: Array) -> Array:
    """Return u, which is z."""
    return u


def find_white_density(_log: SensorLog, u: Array, _own: Array) -> Array:
    """Log N(u; 0, 1)."""
    return _log_normal_density(u)


def find_correlated_z(log: SensorLog, u: Array, phi: Array) -> Array:
    """z_t = (u_t − phi · u_{t−1}) / sqrt(1 − phi²); u_t where the step before was missed."""
    expected = np.where(log.follows[:, None], phi * np.roll(u, 1, axis=0), 0.0)
    z: Array = (u - expected) / _find_new_spread(log, phi)
    return z


def find_correlated_density(log: SensorLog, u: Array, phi: Array) -> Array:
    """Log N(u_t; phi · u_{t−1}, 1 − phi²); log N(u_t; 0, 1) where the step before was missed."""
    spread = np.log(_find_new_spread(log, phi)).sum(axis=1)
    density: Array = _log_normal_density(find_correlated_z(log, u, phi)) - spread
    return density


def _find_new_spread(log: SensorLog, phi: Array) -> Array:
    """Return the standard deviation of u_t given the step before, shape (n, 2)."""
    spread: Array = np.where(log.follows[:, None], np.sqrt(1.0 - phi**2), 1.0)
    return spread


def find_heavy_tailed_z(_log: SensorLog, u: Array, inverse_freedom: Array) -> Array:
    """Z = Φ⁻¹(T(t)), t = u / sqrt((nu − 2) / nu)."""
    nu = 1.0 / float(inverse_freedom[0])
    t = u / sqrt((nu - 2.0) / nu)
    tail = special.stdtr(nu, -np.abs(t))
    z: Array = -np.sign(t) * special.ndtri(np.maximum(tail, np.finfo(float).tiny))
    return z


def find_heavy_tailed_density(_log: SensorLog, u: Array, inverse_freedom: Array) -> Array:
    """Log density of Student's t in unit variance (Abramowitz and Stegun, 26.7.1)."""
    nu = 1.0 / float(inverse_freedom[0])
    norm = lgamma(0.5 * (nu + 1.0)) - lgamma(0.5 * nu) - 0.5 * log((nu - 2.0) * pi)
    density: Array = (norm - 0.5 * (nu + 1.0) * np.log1p(u * u / (nu - 2.0))).sum(axis=1)
    return density


def _log_normal_density(z: Array) -> Array:
    density: Array = -0.5 * np.square(z).sum(axis=1) - log(2.0 * pi)
    return density


def _make_white(parameters: Array) -> DisturbanceModel:
    return _make_model(parameters, White())


def _make_correlated(parameters: Array) -> DisturbanceModel:
    return _make_model(parameters, Correlated(*parameters[4:].tolist()))


def _make_heavy_tailed(parameters: Array) -> DisturbanceModel:
    return _make_model(parameters, HeavyTailed(1.0 / float(parameters[4])))


def _make_model(parameters: Array, shape: Shape) -> DisturbanceModel:
    sigmas = dict(zip(SLOPES_AND_BASES, parameters.tolist(), strict=False))
    return DisturbanceModel(**sigmas, shape=shape)


CANDIDATES = (
    Candidate("white", (), (), (), find_white_density, find_white_z, _make_white),
    Candidate(
        "ar1",
        ("longitudinal_correlation", "lateral_correlation"),
        (0.5, 0.5),
        ((0.0, MOST_CORRELATION),) * 2,
        find_correlated_density,
        find_correlated_z,
        _make_correlated,
    ),
    Candidate(
        "student_t",
        ("1 / degrees_of_freedom",),
        (0.2,),
        ((1.0 / MOST_FREEDOM, 1.0 / LEAST_FREEDOM),),
        find_heavy_tailed_density,
        find_heavy_tailed_z,
        _make_heavy_tailed,
    ),
)


class Parameter(msgspec.Struct, frozen=True):
    """A fitted parameter by its name in `[disturbance]`, with its 95 % interval."""

    name: str
    value: float
    interval: Interval


class Fit(msgspec.Struct, frozen=True, eq=False):
    """The best parameters of one shape.

    Attributes:
        candidate: the shape.
        best: parameters of largest likelihood: slopes and bases, then the shape's own.
        held_out: log density of a measurement on tracks that were not fitted, mean over the log.
        gain: the same less that of white noise, with its interval; None for white noise.
    """

    candidate: Candidate
    best: Array
    held_out: float
    gain: tuple[float, Interval] | None

    @property
    def model(self) -> DisturbanceModel:
        """The disturbance model with these parameters."""
        return self.candidate.make_model(self.best)

    def find_z(self, log: SensorLog) -> Array:
        """Return what the model makes of the errors, shape (n, 2): standard normal if it holds."""
        u = log.error_m / _compute_sigma(log, self.best)
        return self.candidate.find_z(log, u, self.best[4:])


def fit_shapes(log: SensorLog) -> list[Fit]:
    """Return the fits of all shapes; white noise is the first."""
    scores = [_find_held_out(candidate, log) for candidate in CANDIDATES]
    counts = log.sum_by_track(np.ones(len(log.track)))
    return [
        Fit(
            candidate=candidate,
            best=maximize_likelihood(candidate, log),
            held_out=float(score.sum() / counts.sum()),
            gain=None if score is scores[0] else find_ratio_interval(score - scores[0], counts),
        )
        for candidate, score in zip(CANDIDATES, scores, strict=True)
    ]


def choose_fit(fits: Sequence[Fit]) -> Fit:
    """Return the fit with the largest density on tracks that were held out.

    White noise, the simplest, unless the interval of another one's gain over it is above 0.
    """
    better = [fit for fit in fits if fit.gain is not None and fit.gain[1].low > 0.0]
    return max(better, key=lambda fit: fit.held_out, default=fits[0])


def compute_density(candidate: Candidate, log: SensorLog, parameters: Array) -> Array:
    """Return the log density of each measurement's error [m] under some parameters, shape (n,)."""
    sigma = _compute_sigma(log, parameters)
    own = candidate.find_density(log, log.error_m / sigma, parameters[4:])
    density: Array = own - np.log(sigma).sum(axis=1)
    return density


def _compute_sigma(log: SensorLog, parameters: Array) -> Array:
    """Return sigma of each measurement, shape (n, 2). [m]"""
    sigma: Array = parameters[[0, 2]] * log.distance_m + parameters[[1, 3]]
    return sigma


def maximize_likelihood(
    candidate: Candidate, log: SensorLog, *, held_out: Array | None = None
) -> Array:
    """Return the parameters of largest likelihood: slopes and bases, then the shape's own.

    Args:
        candidate: shape of the noise.
        log: log of the errors.
        held_out: measurements that do not count, shape (n,).
    """
    counted = np.ones(len(log.track)) if held_out is None else np.where(held_out, 0.0, 1.0)
    spread = np.sqrt(np.mean(np.square(log.error_m), axis=0))
    near = [value for sigma in spread for value in (0.0, float(np.clip(sigma, 1e-3, MOST_BASE_M)))]
    total = counted.sum()

    def find_loss(parameters: Array) -> float:
        return float(-(counted * compute_density(candidate, log, parameters)).sum() / total)

    found = optimize.minimize(
        find_loss,
        np.array([*near, *candidate.start]),
        method="L-BFGS-B",
        bounds=(*BOUNDS, *candidate.bounds),
        options={"ftol": 1e-12, "gtol": 1e-8, "maxiter": 500},
    )
    best: Array = found.x
    return best


def _find_held_out(candidate: Candidate, log: SensorLog) -> Array:
    """Return log densities summed over each track, by fits to the tracks of the other folds."""
    score = np.zeros(log.tracks)
    fold = np.arange(log.tracks) % FOLDS
    for held in range(FOLDS):
        is_held = fold == held
        best = maximize_likelihood(candidate, log, held_out=is_held[log.track])
        score[is_held] = log.sum_by_track(compute_density(candidate, log, best))[is_held]
    return score


def find_parameters(fit: Fit, log: SensorLog) -> tuple[Parameter, ...]:
    """Return the parameters with the intervals of the jackknife over tracks.

    Each fit without one track is approximated by a step of Newton's method from that with all.

    Raises:
        InvalidValue: the log does not determine all parameters.
    """
    names = (*SLOPES_AND_BASES, *fit.candidate.names)
    limits = (*BOUNDS, *fit.candidate.bounds)
    scores, curvatures = _differentiate(fit.candidate, log, fit.best, np.array(limits))
    total = curvatures.sum(axis=0)
    _refuse_undetermined(total)
    moves = np.linalg.solve(total - curvatures, scores[..., None])[..., 0]
    deviation = np.sqrt((log.tracks - 1) / log.tracks * np.square(moves).sum(axis=0))
    reach = float(stats.t.ppf(0.5 + CONFIDENCE / 2.0, log.tracks - 1)) * deviation
    return tuple(
        _make_parameter(name, float(value), float(room), bounds)
        for name, value, room, bounds in zip(names, fit.best, reach, limits, strict=True)
    )


def _refuse_undetermined(curvature: Array) -> None:
    """Refuse a likelihood that is flat in some direction.

    Raises:
        InvalidValue: it is.
    """
    scale = np.sqrt(np.abs(np.diag(curvature)))
    if not scale.all() or np.linalg.cond(curvature / np.outer(scale, scale)) > WORST_CONDITION:
        raise InvalidValue(
            "log",
            "its distances do not tell how errors grow with them.",
            "Log vehicles at different distances along the road, and in other lanes.",
        )


def _make_parameter(
    name: str, value: float, reach: float, bounds: tuple[float, float]
) -> Parameter:
    low, high = value - reach, value + reach
    if name.endswith("_base_m"):
        # Of a scale the logarithm is nearer to normal than the scale itself.
        ratio = min(reach / value, MOST_SPREADS)
        low, high = value * exp(-ratio), value * exp(ratio)
    low, high = max(low, bounds[0]), min(high, bounds[1])
    if name.startswith("1 / "):
        return Parameter(name.removeprefix("1 / "), 1.0 / value, Interval(1.0 / high, 1.0 / low))
    return Parameter(name, value, Interval(low, high))


def _differentiate(
    candidate: Candidate, log: SensorLog, at: Array, limits: Array
) -> tuple[Array, Array]:
    """Return slopes and curvatures of each track's log likelihood, by central differences.

    Args:
        candidate: shape of the noise.
        log: log of the errors.
        at: parameters; where they lie on a bound, the derivatives are those just inside.
        limits: bounds of the parameters, shape (parameters, 2).

    Returns:
        Shapes (tracks, parameters) and (tracks, parameters, parameters).
    """
    step = DIFFERENCE * np.maximum(np.abs(at), 1e-2)
    best = np.clip(at, limits[:, 0] + step, limits[:, 1] - step)
    unit = np.diag(step)

    def sum_density(parameters: Array) -> Array:
        return log.sum_by_track(compute_density(candidate, log, parameters))

    count = len(best)
    slopes = np.zeros((log.tracks, count))
    curvatures = np.zeros((log.tracks, count, count))
    middle = sum_density(best)
    ahead = [sum_density(best + unit[i]) for i in range(count)]
    behind = [sum_density(best - unit[i]) for i in range(count)]
    for i in range(count):
        slopes[:, i] = (ahead[i] - behind[i]) / (2.0 * step[i])
        curvatures[:, i, i] = (ahead[i] - 2.0 * middle + behind[i]) / step[i] ** 2
        for j in range(i):
            mixed = (
                sum_density(best + unit[i] + unit[j])
                - sum_density(best + unit[i] - unit[j])
                - sum_density(best - unit[i] + unit[j])
                + sum_density(best - unit[i] - unit[j])
            )
            curvatures[:, i, j] = curvatures[:, j, i] = mixed / (4.0 * step[i] * step[j])
    return slopes, curvatures


def find_ratio_interval(
    sums: Array, counts: Array, confidence: float = CONFIDENCE
) -> tuple[float, Interval]:
    """Return the mean of what tracks sum up, and its interval by the jackknife over tracks.

    Args:
        sums: sum of the values of each track, shape (tracks,).
        counts: number of values of each track, shape (tracks,); those without any do not count.
        confidence: probability with which the interval holds the mean.
    """
    sums, counts = sums[counts > 0.0], counts[counts > 0.0]
    tracks = len(sums)
    mean = float(sums.sum() / counts.sum())
    left = (sums.sum() - sums) / (counts.sum() - counts)
    deviation = np.sqrt((tracks - 1) / tracks * np.square(left - mean).sum())
    reach = float(stats.t.ppf(0.5 + confidence / 2.0, tracks - 1) * deviation)
    return mean, Interval(mean - reach, mean + reach)
