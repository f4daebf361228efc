"""Figures: chains of failures on `cut_in`, from those of splitting or AST, and the true ones."""

from collections.abc import Iterator, Sequence
from functools import partial
from math import log, pi
from statistics import fmean

import numpy as np
from benchmarks.episode_pool import EpisodePool
from benchmarks.figures import Figure
from benchmarks.learning_figures import failure_rate, of_seeds
from benchmarks.searches import EARLIER, Found, search, side_by_side
from benchmarks.targets import Target
from benchmarks.truth.mode_reference import TrueFailures, true_failures

from eigenfail.settings import read_settings
from eigenfail.values.arrays import Floats
from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail_searches.chains.diagnostics import measure_projections
from eigenfail_searches.chains.method import ChainSettings, read_state

SEEDS = 3
FOUND_IN: dict[str, tuple[int, dict[str, float]]] = {
    "splitting": (20_000, {}),
    "ast": (400, {"converged_share": 1.0}),
}
"""Episodes and settings of the campaign whose failures chains start from, by its method."""

UNSEEN = 300
"""Added to the seed: the settings of chains were chosen with failures of the seeds below."""

MOVED = 6000
EARLY = 0.05
"""Share of the true failures that counts as early: those of AST are nearly all of that kind."""

SETTINGS: dict[str, dict[str, float]] = {
    "splitting": {"campaign": EARLIER, "chains": 20, "burn_in": 0.1},
    "ast": {"campaign": EARLIER},
}
"""Settings of the chains by the method that finds their starts, as the README recommends them:
failures of splitting are nearly samples already, and more chains hold more of its families."""

OF_Z = "log p(z) per step, z standardised"
"""What `log_p_gap` compares; other claims have log p(a), a density of the errors in metres."""


def chains(method: str, prefix: str, pool: EpisodePool, seed: int) -> Iterator[tuple[str, Figure]]:
    """Campaigns of chains from the failures of a method, one for each seed."""
    seeds = range(seed + UNSEEN, seed + UNSEEN + SEEDS)
    episodes, settings = FOUND_IN[method]
    found_in = [spec_of(method, episodes, each, **settings) for each in seeds]
    starts = [[one.z for one in run.crashes] for run in side_by_side(pool, found_in)]
    specs = [spec_of("chains", MOVED, each, **SETTINGS[method]) for each in seeds]
    runs = pool.each(search, specs, [None] * SEEDS, starts)
    truth = true_failures(pool)
    share = of_seeds([failure_rate(run) for run in runs], "share", MOVED)
    yield f"{prefix}.share_failing", share
    for name, figure in (*compare_samples(method, runs, starts, truth), *summarise_mixing(runs)):
        yield f"{prefix}.{name}", figure


def spec_of(method: str, episodes: int, seed: int, **settings: float) -> CampaignSpec:
    """A campaign with all other settings as they are by default."""
    return CampaignSpec(
        name=method,
        method=method,
        episodes=episodes,
        seed=seed,
        settings=settings,
        scenario="cut_in",
    )


def compare_samples(
    method: str, runs: Sequence[Found], starts: Sequence[Sequence[Floats]], truth: TrueFailures
) -> Iterator[tuple[str, Figure]]:
    """Compare the samples with the true failures: log p(z) per step, groups, early collisions."""
    known = log_p_per_step(truth.noise)
    found = [samples(run) for run in runs]
    gaps = [log_p_per_step(each) - known for each in found]
    before = ", ".join(f"{log_p_per_step(each) - known:.3f}" for each in starts)
    note = f"; of the failures of {method} {before}; {len(truth.noise)} true failures; {OF_Z}"
    yield "log_p_gap", of_seeds(gaps, "nat", len(gaps), note)
    groups = truth.reference
    reached = [groups.spread(each) for each in found]
    of_starts = ", ".join(f"{groups.spread(each):.3g}" for each in starts)
    note = f"; of the failures of {method} {of_starts}; groups that hold 5 % of the samples"
    yield "group_coverage", of_seeds(reached, "share", len(groups.centres), note)
    earliest = float(np.quantile([len(z) for z in truth.noise], EARLY))
    early = [share_before(each, earliest) for each in found]
    of_starts = ", ".join(f"{share_before(each, earliest):.3g}" for each in starts)
    of_true = share_before(truth.noise, earliest)
    note = (
        f"; of the failures of {method} {of_starts}, of the true ones {of_true:.3g}; before step "
    )
    yield "share_early", of_seeds(early, "share", len(early), f"{note}{earliest:.0f}")


def samples(run: Found) -> list[Floats]:
    """Noise of the failures after burn-in."""
    settings = read_settings(ChainSettings, dict(run.spec.settings), "settings")
    first = settings.first_sample(run.spec.episodes)
    early = sum(run.crashed[:first])
    return [one.z for one in run.crashes[early:]]


def share_before(noise: Sequence[Floats], step: float) -> float:
    """Share of failures with fewer steps up to the collision."""
    return fmean(len(z) < step for z in noise)


def log_p_per_step(noise: Sequence[Floats]) -> float:
    """log p(z) over all steps ÷ steps; of noise from p(z) −2.838."""
    steps = sum(map(len, noise))
    squares = sum(float(np.square(z, dtype=np.float64).sum()) for z in noise)
    return -0.5 * squares / steps - log(2.0 * pi)


def summarise_mixing(runs: Sequence[Found]) -> Iterator[tuple[str, Figure]]:
    """The words of the diagnostics on them: the worst projections."""
    states = [read_state(run.state) for run in runs]
    found = [measure_projections(facts.projections, trace) for facts, trace in states]
    worst = "; worst: " + ", ".join(each[0].name for each in found)
    n = fmean(len(trace) for _, trace in states)
    yield "worst_r_hat", of_seeds([each[0].r_hat for each in found], "ratio", int(n), worst)
    fewest = [min(one.effective for one in each) for each in found]
    yield "fewest_effective", of_seeds(fewest, "samples", int(n))


TRIALS = (
    (("chains.from_ast.",), partial(chains, "ast", "chains.from_ast")),
    (
        tuple(f"chains.{name}" for name in ("share", "log_p", "group", "worst", "fewest")),
        partial(chains, "splitting", "chains"),
    ),
)
TARGETS = {
    "chains.share_failing": Target(low=0.4),
    "chains.log_p_gap": Target(low=-0.1, high=0.1),
    "chains.group_coverage": Target(low=0.9),
}
