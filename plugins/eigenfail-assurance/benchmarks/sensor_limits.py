"""Figures: whether the limits that `eigenfail requirement` states hold.

On half spaces of the noise P(failure) is known in closed form. `requirement.covered` is the share
of searches of which no stated limit lies beyond the true one, the smallest over methods and numbers
of values, and `limit_over_truth` behind the name of one how much of the true limit is stated. On
`cut_in` the points of a frontier are confirmed by new episodes of Monte Carlo.
"""

from collections.abc import Callable, Iterator
from math import inf, sqrt
from statistics import NormalDist, median
from types import SimpleNamespace
from typing import Any, NamedTuple

import msgspec
import numpy as np
from benchmarks.episode_loop import tasks
from benchmarks.episode_pool import EpisodePool, make_setup
from benchmarks.figures import Figure
from benchmarks.samples import COMMAND, count_share, share
from benchmarks.targets import Target
from numpy.typing import NDArray

from eigenfail.values.campaign import Campaign, CampaignState, Counts
from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail.values.episode import EpisodeSetup
from eigenfail.values.estimates import Estimate, Interval
from eigenfail_assurance.sensor import anchors, search
from eigenfail_assurance.sensor.scaling import Multiples, scale_model
from eigenfail_services.statistics.intervals import rate
from eigenfail_services.statistics.pooled_estimate import estimate_ended
from eigenfail_services.statistics.subset_simulation import SubsetSettings, simulate_subsets

Array = NDArray[np.float64]
Run = tuple[Counts, Estimate | None]
Robustness = Callable[[Array], Array]

SEARCHES = 100
CHANNELS = ("longitudinal", "lateral")


class Toy(NamedTuple):
    """A half space of the noise, whose border is where a limit is known.

    Attributes:
        method: that bounds P(failure).
        steps: of the noise, with two values each.
        target: largest P(failure) that is accepted.
        episodes: budget of an anchor.
        channels: that are searched.
    """

    method: str
    steps: int
    target: float
    episodes: int
    channels: tuple[str, ...]

    @property
    def name(self) -> str:
        """Part of the name of a figure."""
        return f"{self.method}_{2 * self.steps}{'_jointly' * (len(self.channels) > 1)}"


TOYS = (
    Toy("monte_carlo", 1, 1e-2, 4_000, ("scale",)),
    Toy("monte_carlo", 1, 1e-2, 4_000, CHANNELS),
    *(Toy("subset", steps, 1e-3, 4_000, ("scale",)) for steps in (1, 20)),
)


def find_covered(pool: EpisodePool, seed: int) -> Iterator[tuple[str, Figure]]:
    """How often all limits of a search hold, and how far they reach."""
    shares = []
    for toy in TOYS:
        found = pool.each(search_toy, [toy] * SEARCHES, range(seed, seed + SEARCHES))
        held = share([each <= 1.0 for each in found], f"{toy.episodes} episodes an anchor")
        shares.append(held.value or 0.0)
        yield f"requirement.covered.{toy.name}", held
        note = "median over the searches, 0 where no limit is stated"
        value = Figure(value=median(found), unit="ratio", n=SEARCHES, note=note, command=COMMAND)
        yield f"requirement.covered.{toy.name}.limit_over_truth", value
    note = f"the smallest of {len(TOYS)} toys, {SEARCHES} searches each"
    yield (
        "requirement.covered",
        Figure(value=min(shares), unit="share", n=SEARCHES, note=note, command=COMMAND),
    )


def search_toy(toy: Toy, seed: int) -> float:
    """Return the largest ratio of a stated limit to the true one; 0 if none is stated."""
    limit = float(np.random.default_rng([seed, 1]).uniform(0.8, 1.3))
    border = -limit * NormalDist().inv_cdf(toy.target)
    question = search.RequirementQuestion(target=toy.target, channels=toy.channels)

    def measure(multiples: Multiples, error: float) -> search.Anchor:
        sizes = np.array([multiples.get("scale", multiples.get(each, 1.0)) for each in CHANNELS])

        def robustness(z: Array) -> Array:
            scaled: Array = border - (z * sizes).sum(axis=(1, 2)) / sqrt(z[0].size)
            return scaled

        campaign = run_toy(toy, robustness, seed)
        counts = campaign.counts
        summary = SimpleNamespace(failure_rate=rate(counts.failures, counts.completed))
        client: Any = SimpleNamespace(campaigns=SimpleNamespace(summary=lambda _id: summary))
        return anchors.read_anchor(client, campaign, multiples, toy.target, error)

    answer = search.find_limits(question, measure)
    found = (compare(each, limit) for each in (*answer.limits, *answer.frontier))
    return max(found)


def compare(found: search.ErrorLimit, limit: float) -> float:
    """Return a stated limit ÷ the true one, of the size of all noise; 0 if none is stated."""
    if found.largest is None:
        return 0.0
    if found.channel == "scale":
        return found.largest / limit
    other = next(iter(found.beside.values()), 1.0)
    return sqrt((found.largest**2 + other**2) / 2.0) / limit


def run_toy(toy: Toy, robustness: Robustness, seed: int) -> Campaign:
    """Return a campaign as it would end."""
    counts, found = RUNS[toy.method](toy, robustness, seed)
    spec = CampaignSpec(name=toy.name, method=toy.method, episodes=toy.episodes, seed=seed)
    return Campaign(
        id=1, spec=spec, state=CampaignState.DONE, counts=counts, created_ms=0, estimate=found
    )


def run_monte_carlo(toy: Toy, robustness: Robustness, seed: int) -> Run:
    """Draw from p(x): the same draws at every error."""
    z = np.random.default_rng(seed).standard_normal((toy.episodes, toy.steps, 2))
    failures = int((robustness(z) <= 0.0).sum())
    return Counts(toy.episodes, toy.episodes, failures), None


def run_subset(toy: Toy, robustness: Robustness, seed: int) -> Run:
    """Run subset simulation."""
    failures = 0

    def count(z: Array) -> Array:
        nonlocal failures
        values = robustness(z)
        failures += int((values <= 0.0).sum())
        return values

    done = simulate_subsets(count, (toy.steps, 2), toy.episodes, SubsetSettings(), seed)
    told = estimate_ended(done)
    return Counts(toy.episodes, told.episodes, failures), told


RUNS: dict[str, Callable[[Toy, Robustness, int], Run]] = {
    "monte_carlo": run_monte_carlo,
    "subset": run_subset,
}


ASKED = search.RequirementQuestion(target=1e-2, channels=CHANNELS, points=3)
ANCHOR_EPISODES, CONFIRMING = 3_000, 20_000
BATCH = 100


def find_frontier(pool: EpisodePool, seed: int) -> Iterator[tuple[str, Figure]]:
    """The frontier of `rulebook` in `cut_in`, and P(failure) there by new episodes."""
    setup = make_setup("cut_in", "rulebook")
    confirmed = []
    for place, limit in enumerate(search_frontier(pool, setup, seed).frontier, start=1):
        (kept,) = limit.beside.values()
        name = f"requirement.cut_in.at_{kept:g}"
        tests = f"lateral beside {kept:g} × longitudinal; {ANCHOR_EPISODES} episodes an anchor"
        value = Figure(
            value=limit.largest, unit="multiple", n=len(limit.tests), note=tests, command=COMMAND
        )
        yield f"{name}.limit", value
        is_met = limit.largest is not None
        multiples = {**limit.beside, limit.channel: limit.largest or ASKED.within.low}
        k = count_failures(pool, scale_setup(setup, multiples), seed + place, CONFIRMING, inf)
        where = (
            "at the limit" if is_met else f"at {ASKED.within.low:g} × lateral, where none is met"
        )
        found = share([True] * k + [False] * (CONFIRMING - k), f"new episodes {where}")
        yield f"{name}.failure_rate", found
        low, high = found.interval or (0.0, 1.0)
        confirmed.append(high <= ASKED.target if is_met else low > ASKED.target)
    note = (
        "points of the frontier where the 95 % interval by new episodes is at or below the target, "
        "or above it where no error met it"
    )
    yield "requirement.cut_in.confirmed", count_share(confirmed, note)


def search_frontier(pool: EpisodePool, setup: EpisodeSetup, seed: int) -> search.RequirementAnswer:
    """Return the answer by Monte Carlo, without a service."""

    def measure(multiples: Multiples, error: float) -> search.Anchor:
        most = anchors.find_fewest_failures(ASKED.target, ANCHOR_EPISODES, error) or inf
        k = count_failures(pool, scale_setup(setup, multiples), seed, ANCHOR_EPISODES, most)
        bounds = Interval(
            anchors.intervals.find_lower_bound(k, ANCHOR_EPISODES, error),
            1.0 if k >= most else anchors.intervals.find_upper_bound(k, ANCHOR_EPISODES, error),
        )
        return search.Anchor(
            multiples=dict(multiples),
            campaign=0,
            episodes=ANCHOR_EPISODES,
            failures=k,
            probability=k / ANCHOR_EPISODES,
            bounds=bounds,
            verdict=anchors.judge_bounds(bounds, ASKED.target),
        )

    return search.find_limits(ASKED, measure)


def scale_setup(setup: EpisodeSetup, multiples: Multiples) -> EpisodeSetup:
    """Return the setup with the errors of some channels multiplied."""
    model = scale_model(setup.disturbance, multiples)
    return msgspec.structs.replace(setup, disturbance=model)


def count_failures(
    pool: EpisodePool, setup: EpisodeSetup, seed: int, episodes: int, most: float
) -> int:
    """Count failures of Monte Carlo, until there are as many as decide."""
    failures = 0
    for first in range(0, episodes, BATCH):
        n = min(BATCH, episodes - first)
        failures += sum(one.is_failure for one in pool.play(setup, tasks(first, n, seed)))
        if failures >= most:
            break
    return failures


TRIALS = (
    (("requirement.covered",), find_covered),
    (("requirement.cut_in.",), find_frontier),
)
TARGETS = {"requirement.covered": Target(low=0.93)}
