"""Figures: methods that learn, at the paper's budgets, from three seeds each.

Of every figure the median is stated, and all three beside it: nothing is tuned to a seed.
"""

from collections.abc import Iterator, Sequence
from functools import cache, partial
from statistics import median
from typing import Any

import msgspec
from benchmarks.episode_pool import EpisodePool, make_setup
from benchmarks.figures import Figure
from benchmarks.learning_figures import (
    count_trained,
    deviation,
    each,
    failure_rate,
    first_failure,
    likelier,
    log_p_per_step,
    log_p_ratio,
    middle,
    of_seeds,
    over_heuristics,
    rate_gained,
    severity,
)
from benchmarks.samples import COMMAND
from benchmarks.searches import Found, changed, evaluations, side_by_side
from benchmarks.truth.curves import Curve, curve
from benchmarks.truth.heuristics import SHAPES, rate_at, try_amplitudes
from benchmarks.truth.mode_reference import Reference, reference

from eigenfail import plugins
from eigenfail.values.campaign_spec import CampaignSpec

TRAINED, EVALUATED, MOVED = 1000, 300, 100
SEEDS = 3
TRIED = 100

LIKELY = {
    "alpha": 150.0,
    "c_dist": 15.0,
    "entropy": 30.0,
    "target_entropy": -2.0,
    "averaged": 20,
}
"""AST that weighs log p more than its defaults do: where it is held against noise by chance."""

HELD_BACK = {"max_mean": 0.7}
"""CEM that fails about as often as DiFS does by default, by what seeds 3060 to 3062 showed."""

Figures = Iterator[tuple[str, Figure]]
Findings = Iterator[tuple[str, Figure | tuple[Curve, ...]]]


def learnt(
    pool: EpisodePool,
    seed: int,
    method: str,
    scenario: str = "cut_in",
    *,
    seeds: int = SEEDS,
    **settings: Any,
) -> list[Found]:
    """A campaign of training from each seed, with all else as it is by default."""
    return side_by_side(
        pool,
        [
            CampaignSpec(
                name=method,
                method=method,
                episodes=TRAINED,
                seed=seed + i,
                settings=settings,
                scenario=scenario,
            )
            for i in range(seeds)
        ],
    )


def ast(pool: EpisodePool, seed: int) -> Findings:
    """AST: trained, evaluated, and its policy moved to other distances of the cut-in."""
    runs = learnt(pool, seed, "ast")
    yield "ast", tuple(map(curve, runs))
    place = f"cut_in.ast.train{TRAINED}"
    yield from rates(place, runs)
    yield "cut_in.ast.trained_episodes", middle(runs, count_trained, "episodes", TRAINED)
    yield "cut_in.ast.first_failure_episode", middle(runs, first_failure, "episode", TRAINED)
    evaluated_runs = evaluations(pool, runs, EVALUATED)
    yield from summarise_evaluation("cut_in.ast", evaluated_runs)
    yield from compute_coverage("cut_in.ast", pool, evaluated_runs)
    usual_m = plugins.load(plugins.SCENARIOS, "cut_in").Parameters().distance_m
    for name, offset_m in {"plus5": 5.0, "minus5": -5.0}.items():
        moved = evaluations(pool, runs, MOVED, distance_m=usual_m + offset_m)
        yield f"cut_in.ast.{name}.failure_rate", middle(moved, failure_rate, "share", MOVED)


KNOWING = "squares_lengthways"
"""It knows that longitudinal noise is what breaks this planner; the other shapes know nothing."""


def likely_ast(pool: EpisodePool, seed: int) -> Findings:
    """AST that prefers likely failures, against noise with a shape that is as likely."""
    runs = learnt(pool, seed, "ast", **LIKELY)
    evaluated_runs = evaluations(pool, runs, EVALUATED)
    yield from summarise_evaluation("cut_in.ast_likely", evaluated_runs)
    setup = make_setup("cut_in", "rulebook")
    tried_shapes = {
        name: try_amplitudes(pool, setup, of, TRIED, seed) for name, of in SHAPES.items()
    }
    blind = {name: found for name, found in tried_shapes.items() if name != KNOWING}
    for name, shapes in (("ast_over_heuristic", blind), ("ast_over_knowing", tried_shapes)):
        over = partial(over_heuristics, tried=shapes)
        yield f"cut_in.{name}", middle(evaluated_runs, over, "ratio", EVALUATED)
    at = median(run.log_p_per_step for run in evaluated_runs)
    for name, found in tried_shapes.items():
        note = f"at {at:.3g} per step, between {TRIED} episodes at each of {len(found)} amplitudes"
        yield (
            f"cut_in.heuristic.{name}.failure_rate",
            Figure(value=rate_at(found, at), unit="share", n=TRIED, note=note, command=COMMAND),
        )


def cem(pool: EpisodePool, seed: int) -> Findings:
    """The cross-entropy method."""
    runs = learnt(pool, seed, "cem")
    yield "cem", tuple(map(curve, runs))
    yield from rates(f"cut_in.cem.train{TRAINED}", runs)
    evaluated_runs = evaluations(pool, runs, EVALUATED)
    yield from summarise_evaluation("cut_in.cem", evaluated_runs)
    yield "cut_in.cem.logp_ratio", middle(evaluated_runs, log_p_ratio, "ratio", EVALUATED)
    yield from compute_coverage("cut_in.cem", pool, evaluated_runs)


def difs(pool: EpisodePool, seed: int) -> Findings:
    """DiFS as it is by default, and with the paper's three rounds of 500."""
    runs = learnt(pool, seed, "difs")
    yield "difs", tuple(map(curve, runs))
    yield from rates(f"cut_in.difs.train{TRAINED}", runs)
    evaluated_runs = evaluations(pool, runs, EVALUATED)
    yield from summarise_evaluation("cut_in.difs", evaluated_runs)
    yield "cut_in.difs.logp_ratio", middle(evaluated_runs, log_p_ratio, "ratio", EVALUATED)
    yield "cut_in.difs.sample_std", middle(evaluated_runs, deviation, "sigma", EVALUATED)
    yield from compute_coverage("cut_in.difs", pool, evaluated_runs)
    yield from beside_cem(pool, seed, evaluated_runs)
    full = evaluations(pool, [changed(run, sampling_steps=1000) for run in runs], EVALUATED)
    yield from rates(f"cut_in.difs.ddpm1000.eval{EVALUATED}", full)
    yield "cut_in.difs.default_less_ddpm1000.failure_rate", rate_gained(full, evaluated_runs)
    papers = evaluations(pool, learnt(pool, seed, "difs", schedule="paper"), EVALUATED)
    yield from rates(f"cut_in.difs.paper_preset.eval{EVALUATED}", papers)


def beside_cem(pool: EpisodePool, seed: int, of_difs: Sequence[Found]) -> Figures:
    """DiFS against a cross-entropy method held back until it fails about as often."""
    of_cem = evaluations(pool, learnt(pool, seed, "cem", **HELD_BACK), EVALUATED)
    yield from rates(f"cut_in.cem_held_back.eval{EVALUATED}", of_cem)
    yield "cut_in.cem_held_back.logp_ratio", middle(of_cem, log_p_ratio, "ratio", EVALUATED)
    yield "cut_in.cem_held_back.sample_std", middle(of_cem, deviation, "sigma", EVALUATED)
    yield from compute_coverage("cut_in.cem_held_back", pool, of_cem)
    yield "cut_in.difs_over_cem.logp_per_step", likelier(of_difs, of_cem)


def merge(method: str, pool: EpisodePool, seed: int, **settings: Any) -> Figures:
    """How many failures a method finds where the truck merges; the sum over the seeds."""
    runs = learnt(pool, seed, method, "merge_in", **settings)
    found = [sum(one.crashed) for one in runs]
    yield (
        f"merge_in.{method}.failures",
        Figure(
            value=sum(found),
            unit="episodes",
            n=sum(len(one.crashed) for one in runs),
            spread=(min(found), max(found)),
            note=each(found, "sum"),
            command=COMMAND,
        ),
    )


UNSEEN, MERGES = 40_000, 5
"""Of the seeds in `merge_in`: the first one less the seed of the claims, and how many there are.
None of them was looked at while the rule of restarts was chosen."""


def merge_by_default(pool: EpisodePool, seed: int) -> Figures:
    """AST as it is by default where a truck merges: the least share of failures of the seeds."""
    first = seed + UNSEEN
    shares = [*map(failure_rate, learnt(pool, first, "ast", "merge_in", seeds=MERGES))]
    worst = of_seeds(shares, "share", TRAINED)
    note = f"worst of the seeds {first} to {first + MERGES - 1}; {each(shares)}"
    yield "ast.merge_in_worst", msgspec.structs.replace(worst, value=min(shares), note=note)


def rates(place: str, runs: Sequence[Found]) -> Figures:
    """The failure rate, and how likely the failures are."""
    n = len(runs[0].crashed)
    yield f"{place}.failure_rate", middle(runs, failure_rate, "share", n)
    yield f"{place}.log_p_per_step", middle(runs, log_p_per_step, "nat", n)


def summarise_evaluation(place: str, runs: Sequence[Found]) -> Figures:
    """The same of an evaluation, and how severe."""
    yield from rates(f"{place}.eval{EVALUATED}", runs)
    yield f"{place}.eval{EVALUATED}.mean_severity", middle(runs, severity, "m²/s²", EVALUATED)


def compute_coverage(place: str, pool: EpisodePool, runs: Sequence[Found]) -> Figures:
    """How much of p(x | failure) the failures of all seeds reach together."""
    known = true_failures(pool)
    failures = [one.z for run in runs for one in run.crashes]
    found = f"{known.failures} true failures by brute force"
    apart = f"silhouette {known.silhouette or 0.0:.2f}, of noise {known.noise_silhouette:.2f}"
    note = (
        f"{found}, {known.modes} mode(s), {apart}: of their {len(known.centres)} groups those that "
        "hold 5 % of the failures"
    )
    value, n = known.spread(failures), len(failures)
    yield (
        f"{place}.group_spread",
        Figure(value=value, unit="share", n=n, note=note, command=COMMAND),
    )


@cache
def true_failures(pool: EpisodePool) -> Reference:
    """The reference, made once."""
    return reference(pool)
