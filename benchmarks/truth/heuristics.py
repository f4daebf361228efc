"""Cheap heuristics: noise with a shape that no planner was looked at for, at any amplitude.

What a learner must beat at equal log p per step: otherwise it has learnt nothing that random
numbers could not replace.
"""

from collections.abc import Callable, Iterable, Sequence
from typing import NamedTuple

import msgspec
import numpy as np
from benchmarks.episode_pool import EpisodePool, horizon
from benchmarks.searches import engine
from benchmarks.truth.shapes import AXES, HALF_PERIODS, Array, draw_held_noise

from eigenfail.values.episode import EpisodeResult, EpisodeSetup, EpisodeTask, TrajectorySource

AMPLITUDES = tuple(np.arange(1.0, 3.01, 0.25).tolist())
RAMPS = range(10, 41)
"""Steps from one end of a ramp to the other."""

LENGTHWAYS = AXES[:1]

Axes = Sequence[tuple[float, float]]
Shape = Callable[[np.random.Generator, int, int, float], Array]


class Tried(NamedTuple):
    """What came of one kind of noise at one amplitude.

    `log_p_per_step` is over all episodes, whether they failed or not: log p ÷ steps.
    """

    sigma: float
    failure_rate: float
    log_p_per_step: float
    severity: float


def uniform(rng: np.random.Generator, n: int, steps: int, sigma: float) -> Array:
    """Uniform in ±sigma on both axes, each value held for 5 steps; shape (n, steps, 2)."""
    return draw_held_noise(rng, n, steps, sigma, hold=5)


def squares(rng: np.random.Generator, n: int, steps: int, sigma: float, axes: Axes = AXES) -> Array:
    """Square waves of ±sigma with a random half-period, phase and axis; shape (n, steps, 2)."""
    half = rng.integers(HALF_PERIODS.start, HALF_PERIODS.stop, n)[:, None]
    place = (np.arange(steps) + rng.uniform(0.0, 2.0, (n, 1)) * half) // half
    return _on_axes(rng, np.where(place % 2 == 0, sigma, -sigma), axes)


def squares_lengthways(rng: np.random.Generator, n: int, steps: int, sigma: float) -> Array:
    """Square waves on the longitudinal axis alone."""
    return squares(rng, n, steps, sigma, LENGTHWAYS)


def ramps(rng: np.random.Generator, n: int, steps: int, sigma: float) -> Array:
    """From one end of ±sigma to the other, again and again; random length, phase and axis."""
    length = rng.integers(RAMPS.start, RAMPS.stop, n)[:, None]
    share = (np.arange(steps) / length + rng.uniform(0.0, 1.0, (n, 1))) % 1.0
    sign = rng.choice((1.0, -1.0), (n, 1))
    return _on_axes(rng, sign * sigma * (2.0 * share - 1.0), AXES)


def _on_axes(rng: np.random.Generator, courses: Array, axes: Axes) -> Array:
    chosen = np.asarray(axes)[rng.integers(len(axes), size=len(courses))]
    noises: Array = courses[:, :, None] * chosen[:, None, :]
    return noises


SHAPES: dict[str, Shape] = {
    "held": uniform,
    "squares": squares,
    "squares_lengthways": squares_lengthways,
    "ramps": ramps,
}


def try_amplitudes(
    pool: EpisodePool, setup: EpisodeSetup, shape: Shape, n: int, seed: int
) -> list[Tried]:
    """n episodes of a shape at each amplitude, the smallest first."""
    steps = horizon(setup.scenario)
    noises = [shape(np.random.default_rng(seed), n, steps, sigma) for sigma in AMPLITUDES]
    encoded = [msgspec.json.encode(setup)] * len(noises)
    return pool.each(attempt, encoded, AMPLITUDES, noises)


def attempt(setup: bytes, sigma: float, z: Array) -> Tried:
    """Run noise trajectories z, shape (n, steps, 2), in this process."""
    tasks = [EpisodeTask(i, 0, TrajectorySource(one)) for i, one in enumerate(z.astype(np.float32))]
    return Tried(sigma, *outcome(engine(setup).run(tasks)))


def outcome(results: Iterable[EpisodeResult]) -> tuple[float, float, float]:
    """Failure rate, log p per step, and mean severity of the failures (0 without any)."""
    runs = list(results)
    steps = sum(one.steps for one in runs)
    log_p = sum(one.noise.log_probability for one in runs)
    severities = [one.measures.severity or 0.0 for one in runs if one.is_failure and one.measures]
    severity = sum(severities) / max(len(severities), 1)
    return len(severities) / len(runs), log_p / steps, severity


def rate_at(found: Sequence[Tried], log_p_per_step: float) -> float:
    """The failure rate of a shape where it is as likely, between the amplitudes that were tried.

    Beyond them it is that of the last one: so a shape that is never so unlikely counts by its
    largest amplitude.
    """
    ordered = sorted(found, key=lambda one: one.log_p_per_step)
    return float(
        np.interp(
            log_p_per_step,
            [one.log_p_per_step for one in ordered],
            [one.failure_rate for one in ordered],
        )
    )
