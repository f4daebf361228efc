"""Figures: whether `eigenfail noise fit` finds the models that logs were drawn from.

Logs of `TRACKS` tracks are drawn from disturbance models whose parameters are drawn, too: of the
position alone, and of channels with misses and ghosts. `covered` is the share of the planted
parameters that lie within their 95 % intervals, `shape` how often the planted shape is chosen,
`false_alarms` how often a check fails although the model is right, and `misfits_found` how often
one fails on logs of errors that no model describes. `toy` is how often the probability of a toy
failure under the fitted model lies within the interval of Monte Carlo under the planted one.
`python plugins/eigenfail-noise-fit/benchmarks/noise_fit.py` prints them.
"""

import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from math import nan
from pathlib import Path
from typing import NamedTuple

sys.path.append(str(Path(__file__).parents[3]))

import numpy as np
from benchmarks.episode_pool import EpisodePool, open_pool
from benchmarks.figures import Figure
from benchmarks.samples import COMMAND, count_share, share
from benchmarks.targets import Target
from numpy.typing import NDArray

from eigenfail.intervals import find_interval
from eigenfail.values.channels import GHOST, MISSED, Channel
from eigenfail.values.disturbance import Conversion, DisturbanceModel
from eigenfail.values.estimates import Interval
from eigenfail.values.shapes import (
    MOST_LIKELY,
    Autoregressive,
    ChannelShape,
    Correlated,
    HeavyTailed,
    Markov,
    PerChannel,
    White,
)
from eigenfail.values.student_t import NORMAL
from eigenfail_noise_fit import fitting
from eigenfail_noise_fit.checks import check_position
from eigenfail_noise_fit.report import fit_log
from eigenfail_noise_fit.sensor_log import AXES, Row, SensorLog, make_log

LOGS, TRACKS = 100, 60
STEP_S = 0.1
SHORTEST, LONGEST = 40, 160
MISS_SHARE = 0.02

Array = NDArray[np.float64]


def draw_model(random: np.random.Generator, kind: int) -> DisturbanceModel:
    """Draw a disturbance model: white, ar1 and student_t in turn."""
    shapes = (
        White(),
        Correlated(*random.uniform(0.2, 0.95, 2).tolist()),
        HeavyTailed(float(random.uniform(3.0, 8.0))),
    )
    return DisturbanceModel(
        longitudinal_slope=float(random.uniform(0.005, 0.05)),
        longitudinal_base_m=float(random.uniform(0.2, 2.0)),
        lateral_slope=float(random.uniform(0.005, 0.1)),
        lateral_base_m=float(random.uniform(0.05, 0.5)),
        shape=shapes[kind % len(shapes)],
    )


Bend = Callable[[Array, Array, Array], Array]
"""Errors [m] from those of the model, the true positions [m] and their rates [m/s]; all (n, 2)."""


def draw_log(
    model: DisturbanceModel, random: np.random.Generator, bend: Bend | None = None
) -> SensorLog:
    """Draw a log of positions from a model, or of errors that are bent afterwards.

    It has no row where the sensor missed a vehicle.
    """
    rows: list[Row] = []
    for number in range(TRACKS):
        true, rate = draw_course(random)
        errors = draw_errors(model, true, random)
        if bend is not None:
            errors = bend(errors, true, rate)
        seen = np.where(random.uniform(size=(len(true), 1)) < MISS_SHARE, nan, true + errors)
        begins_s = float(random.uniform(0.0, 100.0))
        rows += [
            Row(f"{number}", begins_s + STEP_S * i, (*true[i].tolist(), *seen[i].tolist()))
            for i in range(len(true))
            if np.isfinite(seen[i, 0])
        ]
    return make_log(rows, STEP_S)


def draw_course(random: np.random.Generator) -> tuple[Array, Array]:
    """Draw true positions of a vehicle from the ego [m], and their rates [m/s], shape (n, 2)."""
    n = int(random.integers(SHORTEST, LONGEST))
    time_s = STEP_S * np.arange(n)
    speed = np.array([random.uniform(-8.0, 3.0), random.uniform(-0.3, 0.3)])
    begin = np.array([random.uniform(20.0, 90.0), random.choice([-3.5, 0.0, 3.5])])
    return begin + speed * time_s[:, None], np.broadcast_to(speed, (n, 2))


def draw_errors(model: DisturbanceModel, true: Array, random: np.random.Generator) -> Array:
    """Draw the errors of a model at true positions, both of shape (n, 2). [m]"""
    conversion = Conversion(model.shape)
    slopes = np.array([model.longitudinal_slope, model.lateral_slope])
    bases = np.array([model.longitudinal_base_m, model.lateral_base_m])
    sigmas = slopes * np.abs(true) + bases
    drawn = random.standard_normal(true.shape)
    return np.array(
        [
            conversion.inject((z[0], z[1]), (sigma[0], sigma[1]))
            for z, sigma in zip(drawn.tolist(), sigmas.tolist(), strict=True)
        ]
    )


BENDS: dict[str, Bend] = {
    "a bias of half a sigma": lambda errors, _true, _rate: errors + 0.5 * errors.std(axis=0),
    "clocks that are 0.3 s apart": lambda errors, _true, rate: errors - 0.3 * rate,
    "sigma by the square of the distance": lambda errors, true, _rate: (
        errors * (0.3 + np.square(true[:, :1] / 50.0))
    ),
    "three in a hundred errors five times as large": lambda errors, _true, _rate: (
        np.where((np.arange(len(errors)) % 33 == 0)[:, None], 5.0, 1.0) * errors
    ),
    "an offset of each track": lambda errors, true, _rate: (
        errors + errors.std(axis=0) * np.sign(np.sin(1e3 * true[0]))
    ),
}
"""What is done to the errors of a model, by name."""


def judge_log(seed: int) -> tuple[list[bool], bool, bool]:
    """Return which parameters are covered, whether the shape is right, whether a check fails."""
    random = np.random.default_rng([seed, 1])
    model = draw_model(random, seed)
    log = draw_log(model, random)
    best = choose_position(log)
    is_right = type(best.model.shape) is type(model.shape)
    found = fitting.find_parameters(best, log.select(*AXES)) if is_right else ()
    return list_covered(model, found), is_right, has_alarm(log, best)


def choose_position(log: SensorLog) -> fitting.Fit:
    """Return the fit to the positions of a log."""
    return fitting.choose_fit(fitting.fit_shapes(log.select(*AXES)))


def list_covered(
    model: DisturbanceModel, found: Sequence[fitting.jackknife.Parameter]
) -> list[bool]:
    """Return for each parameter whether its interval holds the planted value."""
    return [
        one.interval.low <= find_parameter(model, one.name) <= one.interval.high for one in found
    ]


def find_parameter(model: DisturbanceModel, name: str) -> float:
    """Return a parameter of the model, or of its shape."""
    return float(getattr(model, name) if hasattr(model, name) else getattr(model.shape, name))


def judge_bent_log(seed: int, name: str) -> bool:
    """Return whether a check fails on a log of bent errors."""
    random = np.random.default_rng([seed, 2])
    log = draw_log(draw_model(random, seed), random, BENDS[name])
    return has_alarm(log, choose_position(log))


def has_alarm(log: SensorLog, fit: fitting.Fit) -> bool:
    """Whether a check does not hold."""
    return any(not check.holds for check in check_position(log, fit))


QUANTITIES = ("heading", "speed")
SPREADS = {"longitudinal": 1.0, "lateral": 0.2, "heading": 0.02, "speed": 0.5}
"""Order of magnitude of sigma, by channel."""

DRIVE_S = 300.0
"""Time in which the tracks of a log of channels begin. [s]"""


def draw_channels(random: np.random.Generator, number: int) -> dict[str, Channel]:
    """Draw a model of errors of four channels, of misses and of ghosts.

    The rate of misses grows with the distance in every second one.
    """
    shapes: Sequence[Callable[[], ChannelShape]] = (
        White,
        lambda: Autoregressive(float(random.uniform(0.2, 0.95))),
        lambda: HeavyTailed(float(random.uniform(3.0, 8.0))),
    )
    channels = {}
    for place, (name, spread) in enumerate(SPREADS.items()):
        sigma = spread * float(random.uniform(0.3, 2.0))
        sigma_per_m = spread * float(random.uniform(0.005, 0.05))
        shape = shapes[(number + place) % len(shapes)]()
        channels[name] = Channel(name, sigma, sigma_per_m, shape)
    rate, duration = float(random.uniform(0.005, 0.02)), float(random.uniform(1.5, 8.0))
    growth = rate * float(random.uniform(0.03, 0.1))
    missed = Markov(rate, duration, growth) if number % 2 else Markov(rate, duration)
    ghost = Markov(float(random.uniform(0.01, 0.03)), float(random.uniform(1.5, 8.0)))
    return channels | {
        MISSED: Channel(MISSED, shape=missed),
        GHOST: Channel(GHOST, shape=ghost, ahead_m=float(random.uniform(20.0, 60.0))),
    }


def draw_channel_log(channels: Mapping[str, Channel], random: np.random.Generator) -> SensorLog:
    """Draw a log from a model of channels; chains are drawn by hand, not by the product."""
    rows: list[Row] = []
    for number in range(TRACKS):
        true, _ = draw_course(random)
        plane = np.hypot(true[:, 0], true[:, 1])
        values = np.column_stack([true, *np.zeros((len(QUANTITIES), len(true)))])
        distance = np.column_stack([np.abs(true), *[plane] * len(QUANTITIES)])
        seen = values + draw_channel_errors(channels, distance, random)
        seen[draw_chain(get_chain(channels[MISSED]), plane, random)] = nan
        begins = int(random.integers(0, round(DRIVE_S / STEP_S)))
        for i in range(len(true)):
            others = [pair for way in (2, 3) for pair in (values[i, way], seen[i, way])]
            positions = (*values[i, :2].tolist(), *seen[i, :2].tolist())
            time_s = STEP_S * (begins + i)
            rows.append(Row(f"{number}", time_s, positions, tuple(map(float, others))))
    return make_log([*rows, *draw_ghosts(channels[GHOST], random)], STEP_S, QUANTITIES)


def draw_channel_errors(
    channels: Mapping[str, Channel], distance: Array, random: np.random.Generator
) -> Array:
    """Draw the errors of the channels of `SPREADS` at distances, shape (n, 4)."""
    errors = [channels[name] for name in SPREADS]
    conversion = Conversion(PerChannel(tuple(one.shape or White() for one in errors)))
    slopes = np.array([one.sigma_per_m or 0.0 for one in errors])
    sigmas = slopes * distance + np.array([one.sigma or 0.0 for one in errors])
    drawn = random.standard_normal(distance.shape)
    pairs = zip(drawn.tolist(), sigmas.tolist(), strict=True)
    return np.array([conversion.inject(tuple(z), tuple(sigma)) for z, sigma in pairs])


def draw_chain(shape: Markov, distance_m: Array, random: np.random.Generator) -> NDArray[np.bool_]:
    """Draw at which steps an event lasts, stationary from the first one."""
    begins = np.minimum(shape.rate + shape.growth_per_m * distance_m, MOST_LIKELY)
    ends = 1.0 / shape.mean_steps
    lasts, draws = np.zeros(len(distance_m), bool), random.uniform(size=len(distance_m))
    lasts[0] = draws[0] < begins[0] / (begins[0] + ends)
    for step in range(1, len(lasts)):
        lasts[step] = draws[step] < (1.0 - ends if lasts[step - 1] else begins[step])
    return lasts


def draw_ghosts(ghost: Channel, random: np.random.Generator) -> Iterator[Row]:
    """Yield the measurements of ghosts, each of which stands still relative to the ego."""
    ahead_m = ghost.ahead_m or 0.0
    steps = round(DRIVE_S / STEP_S) + LONGEST
    lasts = draw_chain(get_chain(ghost), np.zeros(steps), random)
    number, place_m = 0, ahead_m
    for step in np.flatnonzero(lasts).tolist():
        if not step or not lasts[step - 1]:
            number, place_m = number + 1, ahead_m * float(random.uniform(0.5, 1.5))
        yield Row(f"ghost {number}", STEP_S * step, (nan, nan, place_m, 0.0))


class Judgement(NamedTuple):
    """What a fit to a log of channels found.

    Attributes:
        covered: which parameters lie within their intervals, by name, of channels whose shape is
            right.
        right: whether the shape is right, by channel.
        alarm: whether a check fails.
        toy: whether the probability of the toy failure lies within the interval of Monte Carlo.
    """

    covered: dict[str, bool]
    right: dict[str, bool]
    alarm: bool
    toy: bool


def judge_channels(seed: int) -> Judgement:
    """Return what the fit to a log of channels found."""
    random = np.random.default_rng([seed, 3])
    planted = draw_channels(random, seed)
    _, report = fit_log(draw_channel_log(planted, random))
    found = {one.name: one for one in report.model.list_channels()}
    right = {name: is_like(found[name].shape, planted[name].shape) for name in planted}
    named = {name: find_planted(planted, name) for name in (one.name for one in report.parameters)}
    covered = {
        one.name: one.interval.low <= named[one.name] <= one.interval.high
        for one in report.parameters
        if right[one.name.split(".")[0]]
    }
    limit_m = TOY_SIGMAS * find_sigma(planted[AXES[0]])
    interval = simulate_toy(planted, limit_m, random)
    return Judgement(
        covered,
        right,
        any(not check.holds for check in report.checks),
        interval.low <= compute_toy(found, limit_m) <= interval.high,
    )


def is_like(one: ChannelShape | None, other: ChannelShape | None) -> bool:
    """Whether two shapes are of one kind, with or without growth."""
    if isinstance(one, Markov) and isinstance(other, Markov):
        return bool(one.growth_per_m) == bool(other.growth_per_m)
    return type(one) is type(other)


def find_planted(channels: Mapping[str, Channel], parameter: str) -> float:
    """Return a parameter by its name in a report; NaN if the planted shape has none."""
    name, field = parameter.split(".")
    channel = channels[name]
    return float(getattr(channel, field, getattr(channel.shape, field, nan)))


TOY_M, TOY_RUN, TOY_EPISODES = 40.0, 3, 400
TOY_SIGMAS = 1.5
"""The toy failure: at `TOY_M`, a vehicle is missed for `TOY_RUN` steps in a row, or perceived more
than `TOY_SIGMAS` times the planted sigma too far away."""


def compute_toy(channels: Mapping[str, Channel], limit_m: float) -> float:
    """Return the probability of the toy failure at a step, in closed form."""
    chain, along = get_chain(channels[MISSED]), channels[AXES[0]]
    begins = min(chain.rate + chain.growth_per_m * TOY_M, MOST_LIKELY)
    ends = 1.0 / chain.mean_steps
    run = begins / (begins + ends) * (1.0 - ends) ** (TOY_RUN - 1)
    (z,) = (along.shape or White()).step_back((limit_m / find_sigma(along),), None, (1.0,))
    return 1.0 - (1.0 - run) * NORMAL.cdf(z)


def simulate_toy(
    channels: Mapping[str, Channel], limit_m: float, random: np.random.Generator
) -> Interval:
    """Return the 95 % interval of that probability by Monte Carlo."""
    chain, along = get_chain(channels[MISSED]), channels[AXES[0]]
    distance = np.full(TOY_RUN, TOY_M)
    failures = 0
    for z in random.standard_normal(TOY_EPISODES).tolist():
        (u,) = (along.shape or White()).step((z,), None, (1.0,))
        is_far = find_sigma(along) * u > limit_m
        failures += is_far or bool(draw_chain(chain, distance, random).all())
    return find_interval(failures, TOY_EPISODES)


def get_chain(channel: Channel) -> Markov:
    """Return the shape of an event."""
    assert isinstance(channel.shape, Markov)
    return channel.shape


def find_sigma(channel: Channel) -> float:
    """Return sigma of a channel at `TOY_M`."""
    return (channel.sigma_per_m or 0.0) * TOY_M + (channel.sigma or 0.0)


KINDS = {"errors": tuple(SPREADS), "missed": (MISSED,), "ghost": (GHOST,)}
"""Kinds of channels, by what the names of their figures end in."""


def find_figures(pool: EpisodePool, seed: int) -> Iterator[tuple[str, Figure]]:
    """The figures of logs of positions."""
    judged = pool.each(judge_log, range(seed, seed + LOGS))
    note = f"of the planted parameters, in {LOGS} logs of {TRACKS} tracks"
    yield "fit.covered", count_covered([one for log, _, _ in judged for one in log], note)
    yield "fit.shape", share([right for _, right, _ in judged])
    yield "fit.false_alarms", share([alarm for _, _, alarm in judged])
    names = [name for name in BENDS for _ in range(LOGS // len(BENDS))]
    found = pool.each(judge_bent_log, range(seed, seed + len(names)), names)
    missed = sorted({name for name, alarm in zip(names, found, strict=True) if not alarm})
    note = (
        f"as many logs each with {', '.join(BENDS)}; not always found: {', '.join(missed) or '-'}"
    )
    yield "fit.misfits_found", count_share(found, note)


def find_channel_figures(pool: EpisodePool, seed: int) -> Iterator[tuple[str, Figure]]:
    """The figures of logs of channels."""
    judged = pool.each(judge_channels, range(seed, seed + LOGS))
    note = f"of the planted parameters, in {LOGS} logs of {TRACKS} tracks"
    everything = [one for log in judged for one in log.covered.values()]
    yield "fit.channels.covered", count_covered(everything, note)
    for kind, names in KINDS.items():
        covered = [
            is_covered
            for log in judged
            for name, is_covered in log.covered.items()
            if name.split(".")[0] in names
        ]
        yield f"fit.channels.covered_{kind}", count_covered(covered, note)
        rights = [log.right[name] for log in judged for name in names]
        yield f"fit.channels.shape_{kind}", count_share(rights)
    yield "fit.channels.false_alarms", share([log.alarm for log in judged])
    yield "fit.channels.toy", share([log.toy for log in judged])


def count_covered(covered: Sequence[bool], note: str) -> Figure:
    """Return the share of parameters that are covered, which depend on each other within a log."""
    return Figure(
        value=sum(covered) / len(covered),
        unit="share",
        n=len(covered),
        command=COMMAND,
        note=note,
    )


TRIALS = (
    (("fit.covered", "fit.shape", "fit.false_alarms", "fit.misfits_found"), find_figures),
    (("fit.channels.",), find_channel_figures),
)
TARGETS = {"fit.covered": Target(low=0.93), "fit.channels.covered": Target(low=0.93)}


if __name__ == "__main__":
    with open_pool() as everybody:
        for find in (find_figures, find_channel_figures):
            for name, figure in find(everybody, 20_261_122):
                print(f"{name} {figure.value:.3f} ({figure.n}): {figure.note}")
