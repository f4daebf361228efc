"""Figures: other tools' searches on the same functions and scenarios, and which of them dominate.

Ten seeds each at 1000 calls. A tool calls the episode's function as it calls any other; it goes on
after a failure, and every failure counts.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from itertools import product
from math import ceil, inf, isnan, log, nan, pi
from typing import NamedTuple

import msgspec
import numpy as np
from benchmarks.episode_pool import EpisodePool, horizon
from benchmarks.figures import Figure
from benchmarks.peers.driven_searches import ADAPTED, DRIVEN
from benchmarks.peers.driven_searches import LEAST_LOG_P as LEAST_LOG_P_DRIVEN
from benchmarks.peers.peer_tools import PEERS, Answer, CallsSpent, Task, Vector
from benchmarks.peers.simple_searches import CALLS, FUNCTIONS, PLACES, SEARCHES, SEEDS, describe
from benchmarks.samples import COMMAND
from benchmarks.searches import Crash, crash, engine
from scipy.stats import mannwhitneyu

from eigenfail.contracts import EpisodeEngine
from eigenfail.functions import of_batch
from eigenfail.values.arrays import Floats
from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail.values.episode import EpisodeTask, TrajectorySource
from eigenfail_services.methods import robustness_m
from eigenfail_workers.functions import FunctionEngine

HOLD = 10
"""Steps for which a scenario's noise is held, as `held` and `cma` hold theirs by default."""

SCENARIO_BOUND, FUNCTION_BOUND = 2.0, 4.0
"""Bounds of the tools that need some [sigma]. `ast` reaches as far in scenarios; the two corners
and the four branches do not fail within 2 sigma."""

OTHERS = {**PEERS, **ADAPTED}
"""Searches of other tools, also those that a method of eigenfail calls."""

COMPARED = (*PLACES, *DRIVEN)
"""Where searches are compared."""

POINT = ("failures", "log_p_per_step", "distance")
"""The figures of a search that are a point: of each, more is better."""


class PeerRun(NamedTuple):
    """What came of a tool's search: whether each call failed, and the failures."""

    crashed: tuple[bool, ...]
    crashes: tuple[Crash, ...]


class Calls:
    """The calls of a tool's search: each is an episode in an engine.

    Args:
        episodes: engine of the episodes.
        steps: length of the noise of an episode.
        hold: steps for which a value is held.
        limit: calls after which the search ends.
        find_raw: robustness of noise of shape (1, steps, 2), below 0 within a failure; where there
            is none a failure has 0.
    """

    def __init__(
        self,
        episodes: EpisodeEngine,
        steps: int,
        hold: int,
        limit: int,
        find_raw: Callable[[Floats], Floats] | None = None,
    ) -> None:
        self._episodes = episodes
        self._steps = steps
        self._hold = hold
        self._limit = limit
        self._find_raw = find_raw
        self._crashed: list[bool] = []
        self._crashes: list[Crash] = []

    @property
    def dimension(self) -> int:
        """Number of values in a vector."""
        return 2 * ceil(self._steps / self._hold)

    def call(self, x: Vector) -> Answer:
        """Run the episode of a vector.

        Raises:
            CallsSpent: the search has had its calls.
        """
        if len(self._crashed) >= self._limit:
            raise CallsSpent
        knots = x.reshape(-1, 2).astype(np.float32)
        z = np.repeat(knots, self._hold, axis=0)[: self._steps]
        task = EpisodeTask(len(self._crashed), 0, TrajectorySource(z))
        (result,) = self._episodes.run([task])
        self._crashed.append(result.is_failure)
        if result.is_failure:
            self._crashes.append(crash(result))
        robustness = robustness_m(result)
        if self._find_raw is not None:
            robustness = float(self._find_raw(z[None].astype(np.float64)).item())
        return Answer(robustness, float(np.sum(result.noise.z.astype(np.float64) ** 2)))

    def run(self, search: Callable[[Task], None], bound: float, seed: int) -> PeerRun:
        """Return what comes of a search."""
        task = Task(self.call, self.dimension, bound, self._limit, seed)
        try:
            search(task)
        except Exception:  # a library may wrap what its objective raises
            if len(self._crashed) < self._limit:
                raise
        return PeerRun(tuple(self._crashed), tuple(self._crashes))


def compare_peer(
    place: str, name: str, pool: EpisodePool, seed: int
) -> Iterator[tuple[str, Figure]]:
    """Figures of a tool's search in a scenario, or on a function with known regions."""
    runs = pool.each(search_by_peer, [place] * SEEDS, [name] * SEEDS, range(seed, seed + SEEDS))
    yield from describe(place, name, runs)


def search_by_peer(place: str, name: str, seed: int) -> PeerRun:
    """Run a tool's search once."""
    if place in FUNCTIONS:
        problem = FUNCTIONS[place].make()
        function = FunctionEngine(of_batch(problem.robustness), problem.steps)
        calls = Calls(function, problem.steps, 1, CALLS, problem.robustness)
        return calls.run(PEERS[name].search, FUNCTION_BOUND, seed)
    spec = CampaignSpec(name=name, method="held", episodes=CALLS, scenario=place)
    episodes = engine(msgspec.json.encode(spec.setup()))
    calls = Calls(episodes, horizon(place), HOLD, CALLS)
    return calls.run(PEERS[name].search, SCENARIO_BOUND, seed)


Point = tuple[float, ...]


def dominates(one: Point, other: Point) -> bool:
    """Return whether a point is at least as good in every number, and better in one."""
    return one != other and all(a >= b for a, b in zip(one, other, strict=True))


def count_dominating_all(peers: Iterable[Point], ours: Sequence[Point]) -> int:
    """Number of peers' points that dominate every point of ours."""
    return sum(bool(ours) and all(dominates(peer, own) for own in ours) for peer in peers)


def count_dominating(peers: Iterable[Point], ours: Sequence[Point]) -> int:
    """Number of peers' points that dominate a point of ours, and that none of ours dominates."""
    return sum(
        any(dominates(peer, own) for own in ours) and not _is_dominated(peer, ours)
        for peer in peers
    )


def count_undominated(peers: Iterable[Point], ours: Sequence[Point]) -> int:
    """Number of peers' points that no point of ours dominates."""
    return sum(not _is_dominated(peer, ours) for peer in peers)


def _is_dominated(point: Point, others: Iterable[Point]) -> bool:
    return any(dominates(other, point) for other in others)


COUNTS = {
    "dominated": count_dominating_all,
    "dominating": count_dominating,
    "undominated_peers": count_undominated,
}
"""What is counted over all places, by the name in figures."""


def read_point(figures: Mapping[str, Figure], place: str, name: str) -> Point | None:
    """Return the point of a search; None where it has no failures to compare in most seeds."""
    found = [figures.get(f"search.{place}.{name}.{what}") for what in POINT]
    if any(one is None for one in found):
        return None
    values = [one.value for one in found if one is not None and one.value is not None]
    return tuple(values) if len(values) == len(POINT) else None


def read_points(figures: Mapping[str, Figure], place: str, names: Iterable[str]) -> list[Point]:
    """Return the points of all searches that have one."""
    points = (read_point(figures, place, name) for name in names)
    return [point for point in points if point is not None]


def count_points(figures: Mapping[str, Figure]) -> Iterator[tuple[str, Figure]]:
    """Figures of which points dominate, from the figures of all searches, ours and others'."""
    points = {
        place: (read_points(figures, place, OTHERS), read_points(figures, place, SEARCHES))
        for place in COMPARED
    }
    n = sum(len(peers) for peers, _ in points.values())
    if not n:
        return
    for name, count in COUNTS.items():
        counts = {place: count(*both) for place, both in points.items()}
        each = ", ".join(
            f"{place} {count} of {len(points[place][0])}" for place, count in counts.items()
        )
        yield (
            f"search.{name}",
            Figure(
                value=float(sum(counts.values())),
                unit="points",
                n=n,
                note=f"points of other tools, by place: {each}",
                command=COMMAND,
            ),
        )


MEASURES = {
    "failures": 1,
    "first_failure": -1,
    "log_p_per_step": 1,
    "distance": 1,
    "regions": 1,
    "causes": 1,
}
"""Figures that are compared one by one, and whether more or less of each is better."""

LEAST_LOG_P = {
    place: -log(2.0 * pi) - (FUNCTION_BOUND if place in FUNCTIONS else SCENARIO_BOUND) ** 2
    for place in PLACES
} | LEAST_LOG_P_DRIVEN
"""log p per step of noise at the bounds of the other tools. [nat] Noise beyond them fails more
often, sooner, and in more different ways: searches with less likely failures are compared by their
likelihood alone. In scenarios densities are of errors in metres, which are within 1 nat a step of
those of z."""

LEVEL = 0.05
"""Level of the one-sided test of Mann and Whitney (1947) over the seeds, at which one search is
shown to be better than another."""


def compare_searches(figures: Mapping[str, Figure]) -> Iterator[tuple[str, Figure]]:
    """Yield the figures that compare the searches of eigenfail with those of other tools."""
    yield from count_points(figures)
    yield from count_cells(figures)


def count_cells(figures: Mapping[str, Figure]) -> Iterator[tuple[str, Figure]]:
    """Figures of where the best search of eigenfail is shown to be better than the best other one.

    Each cell is a place and a measure. The best of each side is that of the best median, of the
    same seeds as are then tested: with more searches on one side, its best is luckier.
    """
    cells: dict[str, list[str]] = {"better": [], "worse": [], "undecided": []}
    for place, measure in product(COMPARED, MEASURES):
        ours, theirs = (
            list_comparable(figures, place, measure, names) for names in (SEARCHES, OTHERS)
        )
        if ours and theirs:
            outcome = compare_best(max(ours, key=np.median), max(theirs, key=np.median))
            cells[outcome].append(f"{place} {measure}")
    n = sum(map(len, cells.values()))
    for outcome, found in cells.items() if n else ():
        note = f"of the cells (a place and a measure): {', '.join(found) or 'none'}"
        yield (
            f"search.cells.{outcome}",
            Figure(value=len(found), unit="cells", n=n, note=note, command=COMMAND),
        )


def compare_best(ours: Sequence[float], theirs: Sequence[float]) -> str:
    """Return whether our values are shown to be better or worse than others, or "undecided"."""
    for outcome, larger, smaller in (("better", ours, theirs), ("worse", theirs, ours)):
        if mannwhitneyu(larger, smaller, alternative="greater").pvalue <= LEVEL:
            return outcome
    return "undecided"


def list_comparable(
    figures: Mapping[str, Figure], place: str, measure: str, names: Iterable[str]
) -> list[list[float]]:
    """Return the values by seed of the searches that have some; more is better.

    A seed without a failure has the worst value.
    """
    found = []
    for name in names:
        prefix = f"search.{place}.{name}"
        figure = figures.get(f"{prefix}.{measure}")
        log_p = figures.get(f"{prefix}.log_p_per_step")
        known = log_p.value if log_p else None
        is_likely = known is None or known >= LEAST_LOG_P[place]
        if figure and (measure == "log_p_per_step" or is_likely):
            values = [MEASURES[measure] * value for value in read_seeds(figure)]
            found.append([-inf if isnan(value) else value for value in values])
    return found


def read_seeds(figure: Figure) -> list[float]:
    """Return the value of each seed, from the note of a figure; NaN where a seed has none."""
    listed = figure.note.split("seeds: ", 1)[1].split(";", 1)[0]
    return [nan if each == "–" else float(each) for each in listed.split(", ")]
