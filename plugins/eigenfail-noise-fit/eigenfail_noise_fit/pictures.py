"""Pictures of a fit against its log, and of what a disturbance model draws, as SVG."""

from collections.abc import Iterator
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from scipy import special, stats

from eigenfail.presentation.svg import MUTED, Drawing, draw_svg, pick_mark
from eigenfail.values.channels import EGO, KINDS, MISSED, SCENARIO, Channel, split_name
from eigenfail.values.disturbance import DisturbanceModel
from eigenfail.values.shapes import (
    MOST_LIKELY,
    Autoregressive,
    ChannelShape,
    Correlated,
    Markov,
    Shape,
    White,
)
from eigenfail_noise_fit.checks import shift
from eigenfail_noise_fit.events import ChainFit, MissBand, list_bands
from eigenfail_noise_fit.fitting import Fit, compute_sigma
from eigenfail_noise_fit.jackknife import Array
from eigenfail_noise_fit.report import SHARES, FittedLog
from eigenfail_noise_fit.sensor_log import ErrorSeries, EventSteps

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

PIT_BINS = 20
MOST_LAG = 20
RANGE_BINS = 12
LONGEST_RUN = 20

FARTHEST_M = {"longitudinal": 100.0, "lateral": 10.0}
"""Up to which distance a model is drawn, by quantity; others as along the road. [m]"""

COURSES, COURSE_STEPS, COURSE_SEED = 3, 100, 20_261_122
EVENT_COURSES = 20


class Picture(NamedTuple):
    """A picture as an SVG file, with the name of the file but for its ending."""

    name: str
    svg: str


def draw_fit(fitted: FittedLog) -> Iterator[Picture]:
    """Yield a picture of each channel: the log against the expectation of the model."""
    for fit in fitted.fits:
        errors = fitted.log.select(*fit.channels)
        z = fit.find_z(errors)
        for column, name in enumerate(fit.channels):
            drawing = Drawing(partial(_draw_errors, errors, fit, z, column), 2.6)
            title = f"Errors of {name}: log and fitted model"
            words = (
                "Left: histogram of the probability integral transform, level if the model is "
                "correct. Middle: correlation of standardised errors by lag. Right: root mean "
                "square error by distance, and the fitted sigma."
            )
            yield Picture(name, draw_svg(name, title, words, drawing))
    for chain, steps in fitted.chains:
        drawing = Drawing(partial(_draw_chain, chain, steps), 2.6)
        words = (
            "Left: share of runs that last at least so many steps, and that of the model. Right, "
            "of misses: share of the steps missed by distance, and that of the model."
        )
        title = f"Runs of '{chain.name}': log and fitted model"
        yield Picture(chain.name, draw_svg(chain.name, title, words, drawing))


def _draw_errors(errors: ErrorSeries, fit: Fit, z: Array, column: int, figure: "Figure") -> None:
    left, middle, right = figure.subplots(1, 3)
    _draw_pit(left, z[:, column])
    u = (errors.error / compute_sigma(errors, fit.best))[:, column]
    _draw_correlation(middle, errors, u, _find_correlation(fit, column))
    _draw_sigma(right, errors, fit, column)


def _draw_pit(axes: "Axes", z: Array) -> None:
    style: dict[str, Any] = {"color": pick_mark(0).colour, "alpha": 0.45}
    axes.hist(special.ndtr(z), bins=PIT_BINS, range=(0.0, 1.0), density=True, **style)
    axes.axhline(1.0, color=MUTED, linestyle="--")
    axes.set_xlabel("Φ(z)")
    axes.set_ylabel("density")


def _draw_correlation(axes: "Axes", errors: ErrorSeries, u: Array, phi: float) -> None:
    lags = np.arange(1, MOST_LAG + 1)
    products = [u * shift(u, errors, int(lag)) for lag in lags]
    found = [
        float(one[np.isfinite(one)].mean()) if np.isfinite(one).any() else np.nan
        for one in products
    ]
    axes.plot(lags, np.array(found) / np.mean(np.square(u)), label="log", **_points(0))
    axes.plot(lags, phi**lags, label="model", color=pick_mark(1).colour)
    axes.set_xlabel("lag [steps]")
    axes.set_ylabel("correlation")
    axes.legend()


def _draw_sigma(axes: "Axes", errors: ErrorSeries, fit: Fit, column: int) -> None:
    distance, error = errors.distance_m[:, column], errors.error[:, column]
    edges = np.unique(np.quantile(distance, np.linspace(0.0, 1.0, RANGE_BINS + 1)))
    number = np.clip(np.searchsorted(edges, distance, "right") - 1, 0, len(edges) - 2)
    count = np.maximum(np.bincount(number), 1)
    centre = np.bincount(number, distance) / count
    size = np.sqrt(np.bincount(number, np.square(error)) / count)
    slope, base = fit.best[2 * column], fit.best[2 * column + 1]
    axes.plot(centre, size, label="log", **_points(0))
    ends = np.array([edges[0], edges[-1]])
    axes.plot(ends, slope * ends + base, label="model", color=pick_mark(1).colour)
    axes.set_ylim(bottom=0.0)
    axes.set_xlabel("distance [m]")
    axes.set_ylabel("sigma")
    axes.legend()


def _points(place: int) -> dict[str, Any]:
    style = pick_mark(place)
    return {"color": style.colour, "marker": style.marker, "linestyle": "none"}


def _find_correlation(fit: Fit, column: int) -> float:
    """Return the correlation of a channel from one step to the next."""
    if len(fit.channels) == 1:
        shape: ChannelShape | Shape = fit.channel.shape or White()
        return shape.correlation if isinstance(shape, Autoregressive) else 0.0
    shape = fit.model.shape
    if isinstance(shape, Correlated):
        return (shape.longitudinal_correlation, shape.lateral_correlation)[column]
    return 0.0


def _draw_chain(chain: ChainFit, steps: EventSteps, figure: "Figure") -> None:
    panels = figure.subplots(1, 2 if chain.name == MISSED else 1, squeeze=False)[0]
    _draw_runs(panels[0], chain.shape, steps)
    if chain.name == MISSED:
        _draw_bands(panels[1], chain.shape, list_bands(steps))


def _draw_runs(axes: "Axes", shape: Markov, steps: EventSteps) -> None:
    """Draw the share of runs that reach a length: the product of the shares that went on.

    A run that the log cuts off counts as far as it goes (Kaplan and Meier 1958).
    """
    lengths = np.arange(1, LONGEST_RUN + 1)
    reached = [1.0]
    for length in lengths[:-1]:
        at_risk = steps.before & (steps.age == length)
        goes_on = float(steps.now[at_risk].mean()) if at_risk.any() else np.nan
        reached.append(reached[-1] * goes_on)
    axes.plot(lengths, reached, label="log", **_points(0))
    stays = 1.0 - 1.0 / shape.mean_steps
    axes.plot(lengths, stays ** (lengths - 1), label="model", color=pick_mark(1).colour)
    axes.set_xlabel("length [steps]")
    axes.set_ylabel("share of runs that reach it")
    axes.legend()


def _draw_bands(axes: "Axes", shape: Markov, bands: tuple[MissBand, ...]) -> None:
    centres = np.array([0.5 * sum(band.distance_m) for band in bands])
    shares = np.array([band.share for band in bands])
    below = shares - [band.interval.low for band in bands]
    above = np.array([band.interval.high for band in bands]) - shares
    axes.errorbar(
        centres, 100.0 * shares, 100.0 * np.array([below, above]), label="log", **_points(0)
    )
    distance = np.linspace(bands[0].distance_m[0], bands[-1].distance_m[1], 50)
    axes.plot(
        distance, 100.0 * _find_share(shape, distance), label="model", color=pick_mark(1).colour
    )
    axes.set_ylim(bottom=0.0)
    axes.set_xlabel("distance [m]")
    axes.set_ylabel("missed [%]")
    axes.legend()


def _find_share(shape: Markov, distance_m: Array) -> Array:
    """Return the share of the steps at which an event lasts in the long run, by distance."""
    begins = np.minimum(shape.rate + shape.growth_per_m * distance_m, MOST_LIKELY)
    share: Array = begins / (begins + 1.0 / shape.mean_steps)
    return share


def draw_model(model: DisturbanceModel) -> Iterator[Picture]:
    """Yield a picture of each channel: how large its errors are by distance, and some courses.

    Channels that are drawn once an episode do not get a picture.
    """
    for channel in model.list_channels():
        target, quantity = split_name(channel.name)
        if target == SCENARIO or (quantity in KINDS and channel.sigma is not None):
            continue
        shape = _find_shape(channel, model)
        name = channel.name.replace(".", "-")
        if isinstance(shape, Markov):
            drawing = Drawing(partial(_draw_event_model, shape), 2.6)
            title = f"Events of {channel.name}"
            words = (
                "Left: share of the steps at which the event lasts, by distance. Right: "
                f"{EVENT_COURSES} episodes, one a line; marks are steps at which it lasts."
            )
        else:
            drawing = Drawing(partial(_draw_error_model, channel, shape, model.scale), 2.6)
            title = f"Errors of {channel.name}"
            words = (
                "Left: what 50 %, 95 % and 99.9 % of the errors do not exceed, by distance. Right: "
                f"{COURSES} courses of errors at half of the largest distance drawn."
            )
        yield Picture(name, draw_svg(name, title, words, drawing))


def _find_shape(channel: Channel, model: DisturbanceModel) -> ChannelShape:
    if channel.shape is not None:
        return channel.shape
    if isinstance(model.shape, Correlated):
        axes = {
            "longitudinal": model.shape.longitudinal_correlation,
            "lateral": model.shape.lateral_correlation,
        }
        return Autoregressive(axes[channel.name])
    return model.shape


def _draw_error_model(
    channel: Channel, shape: ChannelShape, scale: float, figure: "Figure"
) -> None:
    left, right = figure.subplots(1, 2)
    target, quantity = split_name(channel.name)
    farthest = FARTHEST_M.get(quantity, FARTHEST_M["longitudinal"])
    distance = np.array([0.0, farthest])
    slope = 0.0 if target == EGO else channel.sigma_per_m or 0.0
    sigma = scale * (slope * distance + (channel.sigma or 0.0))
    for place, (words, share) in enumerate(SHARES.items()):
        upper = float(stats.norm.ppf(0.5 + 0.5 * share))
        factor = shape.step((upper,), None, (1.0,))[0]
        left.plot(distance, factor * sigma, label=words, color=pick_mark(place).colour)
    left.set_ylim(bottom=0.0)
    left.set_xlabel("distance [m]")
    left.set_ylabel(f"size [{channel.unit}]")
    left.legend()
    half = float(sigma.mean())
    for place, course in enumerate(_draw_courses(shape, 1.0, COURSES)):
        right.plot(half * course, color=pick_mark(place).colour)
    right.set_xlabel(f"step, at {0.5 * farthest:g} m")
    right.set_ylabel(f"error [{channel.unit}]")


def _draw_event_model(shape: Markov, figure: "Figure") -> None:
    left, right = figure.subplots(1, 2)
    distance = np.linspace(0.0, FARTHEST_M["longitudinal"], 50)
    left.plot(distance, 100.0 * _find_share(shape, distance), color=pick_mark(0).colour)
    left.set_ylim(bottom=0.0)
    left.set_xlabel("distance [m]")
    left.set_ylabel("steps with the event [%]")
    half = 0.5 * FARTHEST_M["longitudinal"]
    begins = min(shape.rate + shape.growth_per_m * half, MOST_LIKELY)
    for place, course in enumerate(_draw_courses(shape, begins, EVENT_COURSES)):
        lasts = np.flatnonzero(course)
        right.plot(lasts, np.full(len(lasts), place), **_points(0))
    right.set_xlim(0.0, COURSE_STEPS)
    right.set_xlabel(f"step, at {half:g} m")
    right.set_ylabel("episode")


def _draw_courses(shape: ChannelShape, sigma: float, count: int) -> Iterator[Array]:
    """Yield courses of u, drawn from a fixed seed, shape (`COURSE_STEPS`,)."""
    random = np.random.default_rng(COURSE_SEED)
    for _ in range(count):
        course: list[float] = []
        before = None
        for z in random.standard_normal(COURSE_STEPS).tolist():
            before = shape.step((z,), before, (sigma,))
            course.append(before[0])
        yield np.array(course)
