"""Figures: how the analysis does on failures whose modes are known, and DiFS on two corners."""

from collections.abc import Callable, Iterator

import numpy as np
from benchmarks.episode_pool import EpisodePool
from benchmarks.figures import Figure
from benchmarks.samples import share
from benchmarks.truth.known_problems import two_modes
from benchmarks.truth.undisturbed import number
from numpy.typing import NDArray
from sklearn.metrics import adjusted_rand_score

from eigenfail import plugins
from eigenfail.settings import read_settings
from eigenfail.values.analysis import AnalysisSettings
from eigenfail.values.episode import learner_seed
from eigenfail.values.learning import LearnerContext
from eigenfail.values.records import Failures
from eigenfail_services.analysis.job import analyse
from eigenfail_services.campaigns.rounds import Rounds, run_in_process
from eigenfail_workers.functions import FunctionEngine

Noise = NDArray[np.float64]

STEPS, SIZES = 100, (90, 60, 40)
SPREADS = (1.0, 2.0, 2.5, 4.0)
PLANTED_SEEDS = 6
CLOUDS, CLOUD_STEPS, CLOUD_FAILURES, RESAMPLES = 12, 30, 80, 10
PUSH_STEPS = 8
CORNERS, CORNER_EPISODES, LEAST_SHARE = 20, 300, 0.25


def planted(pool: EpisodePool, seed: int) -> Iterator[tuple[str, Figure]]:
    """Three modes with noise around them: whether they are found, and called distinct."""
    for spread in SPREADS:
        seeds = range(seed, seed + PLANTED_SEEDS)
        found = pool.each(compute_agreement, seeds, [spread] * PLANTED_SEEDS)
        place = f"analysis.planted.spread_{spread:g}"
        worst = min(rand for rand, _ in found)
        yield f"{place}.smallest_rand_index", number(worst, "index", PLANTED_SEEDS)
        yield f"{place}.called_distinct", share([distinct for _, distinct in found])


def compute_agreement(seed: int, spread: float) -> tuple[float, bool]:
    """The adjusted Rand index with the truth, and whether the modes are called distinct."""
    random = np.random.default_rng(seed)
    labels = random.permutation(np.repeat(range(len(SIZES)), SIZES))
    noise = three_modes()[labels] + spread * random.standard_normal((len(labels), STEPS, 2))
    result = analyse(failures(noise), STEPS, AnalysisSettings(features="noise"))
    return float(adjusted_rand_score(labels, result.labels)), result.distinct


def three_modes() -> Noise:
    """Pushes of 15 steps, shape (3, STEPS, 2). [sigma]"""
    modes = np.zeros((len(SIZES), STEPS, 2))
    modes[0, 20:35, 0] = 2.5
    modes[1, 50:65, 1] = -2.5
    modes[2, 70:85, 0] = -2.0
    return modes


def clouds(pool: EpisodePool, seed: int) -> Iterator[tuple[str, Figure]]:
    """One cloud of failures, which has no modes: how often it is said to have some."""
    for name in CLOUD_KINDS:
        called = pool.each(is_divided, [name] * CLOUDS, range(seed, seed + CLOUDS))
        yield f"analysis.one_cloud.{name}.called_distinct", share(called)


def white(_random: np.random.Generator, noise: Noise) -> Noise:
    """Nothing but white noise."""
    return noise


def of_exponential_strength(random: np.random.Generator, noise: Noise) -> Noise:
    """A longitudinal push at one time, as strong as an exponential draw."""
    noise[:, 10 : 10 + PUSH_STEPS, 0] += random.exponential(2.0, (len(noise), 1))
    return noise


def at_any_time(random: np.random.Generator, noise: Noise) -> Noise:
    """A longitudinal push that begins at any time."""
    begins = random.integers(0, CLOUD_STEPS - PUSH_STEPS, len(noise))
    for one, begin in zip(noise, begins.tolist(), strict=True):
        one[begin : begin + PUSH_STEPS, 0] += 2.0
    return noise


CLOUD_KINDS: dict[str, Callable[[np.random.Generator, Noise], Noise]] = {
    "white": white,
    "push_of_exponential_strength": of_exponential_strength,
    "push_at_any_time": at_any_time,
}


def is_divided(kind: str, seed: int) -> bool:
    """Whether one cloud is said to have distinct modes."""
    random = np.random.default_rng(seed)
    noise = random.standard_normal((CLOUD_FAILURES, CLOUD_STEPS, 2))
    settings = AnalysisSettings(bootstrap=RESAMPLES, features="noise")
    return analyse(failures(CLOUD_KINDS[kind](random, noise)), CLOUD_STEPS, settings).distinct


def failures(noise: Noise) -> Failures:
    """Noise z, shape (n, steps, 2), as the failures of a campaign."""
    return Failures(tuple(range(len(noise))), tuple(noise.astype(np.float32)))


def corners(pool: EpisodePool, seed: int) -> Iterator[tuple[str, Figure]]:
    """DiFS on a toy with two ways to fail: from how many seeds it finds both."""
    both = pool.each(finds_both, range(seed, seed + CORNERS))
    note = f"{CORNER_EPISODES} episodes each; found: {LEAST_SHARE:.0%} of the failures or more"
    yield "two_corners.difs.found_both", share(both, note)


def finds_both(seed: int) -> bool:
    """Whether each corner has its part of the failures of a campaign."""
    problem, method = two_modes(), plugins.load(plugins.METHODS, "difs")
    nothing = np.zeros((0, problem.steps, 2), np.float32)
    context = LearnerContext(learner_seed(seed), CORNER_EPISODES, problem.steps, nothing)
    learner = method(context, read_settings(method.Settings, {}, "settings"))
    engine = FunctionEngine(problem.robustness, problem.steps)
    results = run_in_process(Rounds(learner, seed, CORNER_EPISODES), engine)
    left = [one.noise.z[0, 0] < 0.0 for one in results if one.is_failure]
    return bool(left) and LEAST_SHARE <= float(np.mean(left)) <= 1.0 - LEAST_SHARE
