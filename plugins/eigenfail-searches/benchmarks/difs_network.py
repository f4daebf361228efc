"""Figures: what the network of `difs` finds beside a mixture of normals, `mixture_ce`.

Functions are pushes of ten steps in one of two channels, over 100 steps: in any of four windows, or
at any time. After a campaign each model draws samples at robustness 0.
"""

from collections.abc import Callable, Iterator, Mapping
from functools import partial
from math import nan
from statistics import median
from typing import Any, NamedTuple

import numpy as np
from benchmarks.episode_pool import EpisodePool
from benchmarks.figures import Figure
from benchmarks.learning_figures import of_seeds
from benchmarks.samples import COMMAND
from benchmarks.searches import Found, context, list_evaluations, search, search_function
from benchmarks.targets import Target
from benchmarks.truth.known_problems import Noise, Problem
from numpy.typing import NDArray

from eigenfail import plugins
from eigenfail.functions import of_batch
from eigenfail.settings import read_settings
from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail.values.requirements import MeasureLimit

STEPS, PUSH = 100, 10
"""Number of steps of an episode of a function, and of a push."""

WINDOWS = (1, 3, 5, 7)
"""Numbers of the windows in which a push fails, of ten successive windows."""

REACH_OF_WINDOWS, REACH_OF_ANY_TIME = 4.0, 5.0
"""Sum of a push that fails, in its standard deviations: P is 1.3e-4 and about 4e-5."""


def sum_windows(z: Noise) -> Noise:
    """The standardised sums over the four windows, shape (n, 4)."""
    sums = z[:, :, 0].reshape(len(z), -1, PUSH).sum(axis=2) / np.sqrt(PUSH)
    return sums[:, WINDOWS]


def sum_pushes(z: Noise) -> Noise:
    """The standardised sums over ten steps that begin at each step, shape (n, 91)."""
    total = np.cumsum(np.pad(z[:, :, 0], ((0, 0), (1, 0))), axis=1)
    return (total[:, PUSH:] - total[:, :-PUSH]) / np.sqrt(PUSH)


def find_window(z: Noise) -> NDArray[np.intp]:
    """The window with the largest push, shape (n,)."""
    window: NDArray[np.intp] = sum_windows(z).argmax(axis=1)
    return window


def find_region(z: Noise) -> NDArray[np.intp]:
    """The tenth of the episode with the largest push, twice for its sign, shape (n,)."""
    sums = sum_pushes(z)
    begin = np.abs(sums).argmax(axis=1)
    upwards = np.take_along_axis(sums, begin[:, None], axis=1)[:, 0] > 0.0
    tenth = np.minimum((begin + PUSH // 2) // PUSH, STEPS // PUSH - 1)
    region: NDArray[np.intp] = 2 * tenth + upwards
    return region


class Pushes(NamedTuple):
    """A function, and the region of each of its failures."""

    problem: Problem
    find_region: Callable[[Noise], NDArray[np.intp]]


FUNCTIONS = {
    "four_windows": Pushes(
        Problem(
            "push in a window",
            STEPS,
            nan,
            of_batch(lambda z: REACH_OF_WINDOWS - sum_windows(z).max(axis=1)),
        ),
        find_window,
    ),
    "any_time": Pushes(
        Problem(
            "push at any time",
            STEPS,
            nan,
            of_batch(lambda z: REACH_OF_ANY_TIME - np.abs(sum_pushes(z)).max(axis=1)),
        ),
        find_region,
    ),
}
SCENARIOS: Mapping[str, Mapping[str, Any]] = {
    "cut_in": {"scenario": "cut_in"},
    "merge_in": {"scenario": "merge_in"},
    # The smallest distance is the same in every drive without a collision.
    "highway_drive": {
        "scenario": "highway_drive",
        "importance": MeasureLimit(measure="min_ttc_s", at_least=0.0),
    },
}
MODELS = {
    "network": "difs",
    "mixture": "mixture_ce",
}
"""Methods with their default settings: a conditional network, and at most four normals."""

CALLS, EPISODES, SAMPLED, SEEDS = 5000, 1000, 300, 5
UNSEEN = 600
"""Added to the seed: the settings were chosen with other seeds."""


class Samples(NamedTuple):
    """Failures of a campaign, and of the samples after it.

    Attributes:
        found: failures of the campaign.
        failures: failures among the samples.
        mean_square_z: their mean z²; None without failures.
        regions: number of regions with a failure; None in a scenario.
        effective: 1 ÷ the sum of the squared shares of the regions; None in a scenario.
    """

    found: int
    failures: int
    mean_square_z: float | None
    regions: int | None = None
    effective: float | None = None


def compare(place: str, pool: EpisodePool, seed: int) -> Iterator[tuple[str, Figure]]:
    """What each model finds at a place, and failures with the network over those without."""
    first = seed + UNSEEN
    failures = {}
    for model in MODELS:
        given = [place] * SEEDS, [model] * SEEDS, range(first, first + SEEDS)
        runs = pool.each(sample_place, *given)
        failures[model] = median(run.failures for run in runs)
        yield from describe(f"difs.{place}.{model}", place, runs)
    ratio = failures["network"] / failures["mixture"] if failures["mixture"] else None
    note = f"medians of {SEEDS} seeds: {failures['network']:g} and {failures['mixture']:g}"
    figure = Figure(value=ratio, unit="ratio", n=SEEDS, command=COMMAND, note=note)
    yield f"difs.network_gain.{place}", figure


def describe(prefix: str, place: str, runs: list[Samples]) -> Iterator[tuple[str, Figure]]:
    """The figures of one model at one place."""
    budget = CALLS if place in FUNCTIONS else EPISODES
    yield f"{prefix}.found", of_seeds([run.found for run in runs], "episodes", budget)
    yield f"{prefix}.failures", of_seeds([run.failures for run in runs], "episodes", SAMPLED)
    squares = [run.mean_square_z for run in runs]
    yield f"{prefix}.mean_square_z", of_seeds(squares, "sigma²", SAMPLED)
    if place in FUNCTIONS:
        yield f"{prefix}.regions", of_seeds([run.regions for run in runs], "regions", SAMPLED)
        effective = [run.effective for run in runs]
        yield f"{prefix}.effective_regions", of_seeds(effective, "regions", SAMPLED)


def sample_place(place: str, model: str, seed: int) -> Samples:
    """Run a campaign, and sample its model."""
    spec = CampaignSpec(
        name=place,
        method=MODELS[model],
        episodes=CALLS if place in FUNCTIONS else EPISODES,
        seed=seed,
        **({} if place in FUNCTIONS else SCENARIOS[place]),
    )
    return sample_function(spec) if place in FUNCTIONS else sample_scenario(spec)


def sample_function(spec: CampaignSpec) -> Samples:
    """Sample what a campaign on a function has learnt."""
    function = FUNCTIONS[spec.name]
    run = search_function(spec, function.problem)
    method = plugins.load(plugins.METHODS, spec.method)
    settings = read_settings(method.Settings, spec.settings, "settings")
    learner = method(context(spec, STEPS, None), settings)
    learner.restore(run.state)
    z = np.stack([one.z for one in learner.exploit(SAMPLED).sources]).astype(np.float64)
    failed = z[np.asarray(function.problem.robustness(z)) <= 0.0]
    if not len(failed):
        return Samples(sum(run.crashed), 0, None, 0, 0.0)
    counts = np.unique(function.find_region(failed), return_counts=True)[1]
    effective = float(1.0 / np.sum((counts / counts.sum()) ** 2))
    squares = float(np.mean(failed**2))
    return Samples(sum(run.crashed), len(failed), squares, len(counts), effective)


def sample_scenario(spec: CampaignSpec) -> Samples:
    """Sample what a campaign in a scenario has learnt."""
    run = search(spec)
    (evaluation,) = list_evaluations([run], SAMPLED)
    sampled: Found = search(evaluation, run)
    squares = [float(np.mean(one.z.astype(np.float64) ** 2)) for one in sampled.crashes]
    mean = float(np.mean(squares)) if squares else None
    return Samples(sum(run.crashed), sum(sampled.crashed), mean)


TRIALS = tuple(
    ((f"difs.{place}.", f"difs.network_gain.{place}"), partial(compare, place))
    for place in (*FUNCTIONS, *SCENARIOS)
)
TARGETS = {
    "difs.any_time.network.regions": Target(low=15.0),
    **{f"difs.network_gain.{place}": Target(low=2.0) for place in ("any_time", "four_windows")},
    **{
        f"difs.{place}.network.mean_square_z": Target(high=1.5)
        for place in ("any_time", "four_windows")
    },
}
