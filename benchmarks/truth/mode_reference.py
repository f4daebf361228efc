"""A large reference sample of p(x | failure), its modes, and how many of them a method finds.

By brute force: of 7,000,000 draws from p(x) a compiled model of the planner, which is not part of
the project, called some hundred failures. `true_failures.json` holds the numbers of those that
the planner itself confirmed. The noise is drawn again from the seed, and run again here; what does
not crash is no part of the reference. Subset simulation will not do: with 1000 samples on a level
all failures descended from one first draw, and its groups are then groups of kinship.

K-means finds groups in pure noise too (`analysis.clusters`). Where the silhouette of the reference
does not exceed that of noise of the same covariance, the reference has one mode, and `coverage` is
1 for whoever finds any failure. The groups of the best partition are still a ruler that is fixed
beforehand: `spread` says how many of them a method reaches.

`python -m benchmarks.truth.mode_reference` tells the modes on cut_in.
"""

import time
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import msgspec
import numpy as np
from benchmarks.episode_pool import EpisodePool, horizon, make_setup, open_pool
from benchmarks.figures import RESULTS, Figure
from benchmarks.samples import COMMAND
from numpy.typing import NDArray
from scipy.stats import binomtest

from eigenfail import plugins
from eigenfail.values.arrays import Floats
from eigenfail_services.analysis import clusters, components
from eigenfail_services.statistics.intervals import rate

Array = NDArray[np.float64]

COMPONENTS = 5
LEAST_SHARE = 0.05
"""A mode counts as found if it holds that share of a method's failures."""

LEAST = "of the draws, only those that once crashed it were run again"

PLAIN_FAILURES, PLAIN_EPISODES = 118 + 79, 3_325_000 + 2_500_000
PLAIN = (
    "plain Monte Carlo, run once with each of two compiled ports of the scenario and the planner "
    "that are not part of the project (118 of 3,325,000 and 79 of 2,500,000); each failure was run "
    "again with the planner itself and collided; the counts are stored in "
    "benchmarks/truth/mode_reference.py and are not run again, whatever the seed"
)
"""As many episodes would take the planner itself a day on two cores."""


class BruteForce(msgspec.Struct, frozen=True):
    """Which of the draws from p(x) ended in a failure of `rulebook` at a scenario's defaults."""

    seed: int
    draws: int
    batch: int
    scenario: str
    failures: tuple[int, ...]

    def noise(self, steps: int) -> Floats:
        """Their noise z, shape (failures, steps, 2). [sigma]"""
        rng = np.random.default_rng(self.seed)
        found = []
        for first in range(0, self.draws, self.batch):
            z = rng.standard_normal((self.batch, steps, 2), dtype=np.float32)
            found += [z[i - first] for i in self.failures if first <= i < first + self.batch]
        return np.stack(found)


class Reference(NamedTuple):
    """The modes of p(x | failure).

    Attributes:
        failures: how many independent ones they rest on.
        centres: of the groups in the space of components, shape (groups, k).
        silhouette: of the groups, and of groups in noise; the former is None for a single group.
    """

    failures: int
    space: components.ComponentSpace
    centres: Array
    silhouette: float | None
    noise_silhouette: float

    @property
    def modes(self) -> int:
        """As many as the groups, if these are more than what noise shows; else one."""
        distinct = self.silhouette is not None and self.silhouette > self.noise_silhouette
        return len(self.centres) if distinct else 1

    def shares(self, failures: Sequence[Floats]) -> Array:
        """The share of a method's failures z in each group, shape (groups,)."""
        rows = table(failures, self.space.mean.size // 2) - self.space.mean
        scores = rows @ self.space.components.T
        distances = np.linalg.norm(scores[:, None] - self.centres, axis=2)
        held = np.bincount(distances.argmin(axis=1), minlength=len(self.centres))
        share: Array = held / max(len(failures), 1)
        return share

    def spread(self, failures: Sequence[Floats]) -> float:
        """The share of the groups that hold 5 % of a method's failures, modes or not."""
        if not failures:
            return 0.0
        return float((self.shares(failures) >= LEAST_SHARE).mean())


class TrueFailures(NamedTuple):
    """Failures under p(x): noise z of each, shape (steps to the collision, 2), and their modes."""

    noise: tuple[Floats, ...]
    reference: Reference


def brute_force() -> BruteForce:
    """What is kept of the draws."""
    kept = (RESULTS / "true_failures.json").read_bytes()
    return msgspec.json.decode(kept, type=BruteForce)


def confirmed(pool: EpisodePool, _seed: int) -> Iterator[tuple[str, Figure]]:
    """How many of the draws crash `rulebook`: no fewer than these, whose noise is run again."""
    found = brute_force()
    z = found.noise(horizon(found.scenario))
    played = pool.inject(make_setup(found.scenario, "rulebook"), z)
    crashes = [one for one in played if one.is_failure]
    share, n = rate(len(crashes), found.draws), found.draws
    ends = (share.interval.low, share.interval.high)
    count = Figure(value=len(crashes), unit="episodes", n=n, command=COMMAND)
    yield "cut_in.true_failures.count", count
    least = Figure(
        value=share.value, unit="probability", n=n, interval=ends, command=COMMAND, note=LEAST
    )
    yield "cut_in.true_failures.p_fail_at_least", least


STORED_COMMAND = (
    "none: measured once outside the project; python -m benchmarks.claims repeats the stored counts"
)


def plain_monte_carlo(_crew: EpisodePool, _seed: int) -> Iterator[tuple[str, Figure]]:
    """P(failure) of `rulebook` at the defaults of `cut_in`, with its exact 95 % interval."""
    share = binomtest(PLAIN_FAILURES, PLAIN_EPISODES)
    ends = share.proportion_ci(0.95, "exact")
    found = Figure(
        value=PLAIN_FAILURES / PLAIN_EPISODES,
        unit="probability",
        n=PLAIN_EPISODES,
        interval=(float(ends.low), float(ends.high)),
        command=STORED_COMMAND,
        note=f"{PLAIN_FAILURES} failures; {PLAIN}",
    )
    yield "cut_in.rulebook.plain_monte_carlo.p_fail", found


def reference(pool: EpisodePool) -> Reference:
    """The reference for `rulebook` in `cut_in` at its defaults."""
    return true_failures(pool).reference


def true_failures(pool: EpisodePool) -> TrueFailures:
    """The true failures of `rulebook` in `cut_in` at its defaults, each up to its collision."""
    found = brute_force()
    z = found.noise(horizon(found.scenario))
    played = pool.inject(make_setup(found.scenario, "rulebook"), z)
    ends_s = [one.measures.collided_s for one in played]
    failures = [one for one, end_s in zip(z, ends_s, strict=True) if end_s is not None]
    ends = [round(end_s / step_s(found.scenario)) for end_s in ends_s if end_s is not None]
    noise = tuple(one[:end] for one, end in zip(failures, ends, strict=True))
    return TrueFailures(noise, modes(failures, min(ends)))


def modes(failures: Sequence[Floats], shown: int) -> Reference:
    """The groups among failures, by the steps that all of them have.

    Args:
        failures: z of each, shape (steps, 2).
        shown: how many steps are compared.
    """
    space = components.fit_components(table(failures, shown), COMPONENTS)
    partition = clusters.divide(space.scores, None)
    names = np.unique(partition.labels)
    centres = np.array([space.scores[partition.labels == name].mean(axis=0) for name in names])
    noise = clusters.compute_noise_silhouette(space.scores, None)
    return Reference(len(failures), space, centres, partition.silhouette, noise)


def table(failures: Sequence[Floats], shown: int) -> Array:
    """One row for each failure, its first steps, zero behind its end."""
    rows = np.zeros((len(failures), shown, 2))
    for row, z in zip(rows, failures, strict=True):
        row[: len(z)] = z[:shown]
    return rows.reshape(len(failures), -1)


def step_s(scenario: str) -> float:
    """Seconds in a step."""
    plugin = plugins.load(plugins.SCENARIOS, scenario)
    return float(plugin()(plugin.Parameters(), 0).mission.dt_s)


def main() -> None:
    """Make the reference and tell what it shows."""
    began = time.perf_counter()
    with open_pool() as hands:
        found = reference(hands)
    print(
        f"{found.failures} failures: {found.modes} mode(s); "
        f"{len(found.centres)} groups of silhouette {found.silhouette or 0.0:.3f}, "
        f"noise {found.noise_silhouette:.3f}; {time.perf_counter() - began:.0f} s"
    )


if __name__ == "__main__":
    main()
