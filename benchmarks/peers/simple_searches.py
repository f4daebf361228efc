"""Figures: what a learner adds over simple searches, from ten seeds each at 1000 calls.

`cut_in` has no known regions of failures; of the functions they are known.
"""

from collections.abc import Callable, Iterator, Sequence
from math import comb, sqrt
from typing import Any, NamedTuple, Protocol

import msgspec
import numpy as np
from benchmarks.episode_pool import EpisodePool
from benchmarks.figures import Figure
from benchmarks.learning_figures import first_failure, log_p_per_step, of_seeds
from benchmarks.searches import Crash, Found, search, search_function
from benchmarks.truth.known_problems import Noise, Problem, four_branches, two_modes, walk

from eigenfail.values.campaign_spec import CampaignSpec

CALLS, SEEDS = 1000, 10
LEAST_SHARE = 0.05

ONE_RUN = {"runs": 1, "first_spread": 0.0, "first_step": 1.0}
"""CMA-ES as it is usually run: once, from the most likely noise."""

MANY_FAILURES = {
    "runs": 2,
    "population": 6,
    "first_spread": 0.5,
    "first_step": 0.8,
    "max_std": 0.7,
    "failing_share": 1.0,
}
"""CMA-ES for many failures: no generation is to have an episode that does not fail."""

WIDE = {
    "runs": 10,
    "population": 6,
    "first_spread": 3.0,
    "first_step": 0.7,
    "max_std": 0.7,
    "failing_share": 1.0,
}
"""CMA-ES for failures far apart: many runs, which start beyond ordinary noise."""

NARROW = {
    "runs": 1,
    "scale": 3.0,
    "acceptance": 0.995,
    "temperature": 0.01,
    "cooling": 5,
    "restart": 100_000,
}
"""Annealing for many failures: one run, whose moves among failures become so short that few end
outside, and which starts beyond ordinary noise."""

SEARCHES: dict[str, tuple[str, dict[str, Any]]] = {
    "held": ("held", {}),
    "cma": ("cma", {}),
    "cma_one_run": ("cma", ONE_RUN),
    "cma_many": ("cma", MANY_FAILURES),
    "cma_wide": ("cma", WIDE),
    "annealing": ("annealing", {}),
    "annealing_narrow": ("annealing", NARROW),
    "ast": ("ast", {"patience": None}),
    "ast_wide": ("ast", {"patience": None, "amplitude": 4.0}),
    "cem": ("cem", {}),
    "difs": ("difs", {}),
    "go_explore": ("go_explore", {}),
}
"""Methods and settings by the name in figures; `ast` is one search, without restarts."""

ON_ROADS = {"difs", "go_explore"}
"""Searches that do not run on functions. `go_explore` continues episodes from a step on, which
functions do not have. Figures `difs.*` are about `difs` on functions with more regions."""


class KnownRegions(NamedTuple):
    """A function of noise, and the region in which a failure lies, by its noise (steps, 2)."""

    make: Callable[[], Problem]
    find_region: Callable[[Noise], int]


def find_corner(z: Noise) -> int:
    """The left corner or the right one."""
    return int(z[0, 0] > 0.0)


def find_branch(z: Noise) -> int:
    """Which of the four branches: the two curved ones, then the two planes."""
    a, b = z[0]
    curved, plane = 3.0 + 0.1 * (a - b) ** 2, 7.0 / sqrt(2.0)
    along = (a + b) / sqrt(2.0)
    return int(np.argmin([curved - along, curved + along, a - b + plane, b - a + plane]))


def find_side(z: Noise) -> int:
    """On which side the walk left its band."""
    course = np.cumsum(z.ravel())
    return int(course[np.argmax(np.abs(course))] > 0.0)


FUNCTIONS = {
    "walk": KnownRegions(walk, find_side),
    "corners": KnownRegions(two_modes, find_corner),
    "four_branches": KnownRegions(four_branches, find_branch),
}
PLACES = ("cut_in", "merge_in", *FUNCTIONS)


def list_searches(place: str) -> list[str]:
    """The searches that run at a place."""
    return [name for name in SEARCHES if place not in FUNCTIONS or name not in ON_ROADS]


class Run(Protocol):
    """What is described of a search: whether each episode failed, and the failures."""

    @property
    def crashed(self) -> tuple[bool, ...]: ...

    @property
    def crashes(self) -> tuple[Crash, ...]: ...


def compare(place: str, name: str, pool: EpisodePool, seed: int) -> Iterator[tuple[str, Figure]]:
    """A search in a scenario, or on a function with known regions."""
    runs = pool.each(find, [place] * SEEDS, [name] * SEEDS, range(seed, seed + SEEDS))
    yield from describe(place, name, runs)


def describe(
    place: str, name: str, runs: Sequence[Run], calls: int = CALLS
) -> Iterator[tuple[str, Figure]]:
    """Figures of a search, from its runs."""
    prefix = f"search.{place}.{name}"
    for what, unit, value_of in (
        ("failures", "episodes", count_failures),
        ("first_failure", "episode", first_failure),
        ("log_p_per_step", "nat", log_p_per_step),
        ("distance", "sigma", find_distance),
    ):
        yield f"{prefix}.{what}", of_seeds([value_of(run) for run in runs], unit, calls)
    if place in FUNCTIONS:
        counts = [float(count_regions(place, run)) for run in runs]
        note = f"; regions that hold {LEAST_SHARE:.0%} of the failures or more"
        yield f"{prefix}.regions", of_seeds(counts, "regions", CALLS, note)


def find(place: str, name: str, seed: int) -> Found:
    """Run one campaign."""
    method, settings = SEARCHES[name]
    spec = CampaignSpec(name=name, method=method, episodes=CALLS, seed=seed, settings=settings)
    if place in FUNCTIONS:
        return search_function(spec, FUNCTIONS[place].make())
    return search(msgspec.structs.replace(spec, scenario=place))


def count_failures(run: Run) -> float:
    """Episodes that failed."""
    return float(sum(run.crashed))


def find_distance(run: Run) -> float | None:
    """Mean over all pairs of failures of the root mean square difference of z. [sigma]

    It is taken over the steps that both have. Independent draws of p(x) are sqrt(2) apart.
    """
    noise = sorted((one.z.astype(np.float64).ravel() for one in run.crashes), key=len)
    if len(noise) < 2:
        return None
    padded = np.zeros((len(noise), len(noise[-1])))
    for row, z in zip(padded, noise, strict=True):
        row[: len(z)] = z
    squares = np.cumsum(padded**2, axis=1)
    distances = 0.0
    for i, z in enumerate(noise):
        # Those behind it are as long or longer: it has the steps that both have.
        last = len(z) - 1
        dots = padded[i + 1 :, : len(z)] @ z
        sums = squares[i + 1 :, last] + squares[i, last] - 2.0 * dots
        distances += float(np.sqrt(np.maximum(sums, 0.0) / len(z)).sum())
    return distances / comb(len(noise), 2)


def count_regions(place: str, run: Run) -> int:
    """Number of regions that hold at least `LEAST_SHARE` of the failures."""
    regions = [FUNCTIONS[place].find_region(one.z) for one in run.crashes]
    counts = [regions.count(region) for region in set(regions)]
    return sum(count >= LEAST_SHARE * len(regions) for count in counts)
