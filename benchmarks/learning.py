"""Figures: methods that learn, at the paper's budgets, from three seeds each.

Of every figure the median is stated, and all three beside it: nothing is tuned to a seed.
"""

from collections.abc import Callable, Iterator, Sequence
from math import fsum, sqrt
from statistics import fmean, median
from typing import Any

from crew import Crew
from curves import Curve, curve
from figures import Figure
from samples import COMMAND
from searches import Found, evaluations, side_by_side

from eigenfail import plugins
from eigenfail.values import CampaignSpec
from eigenfail_services.statistics.intervals import rate

TRAINED, EVALUATED, MOVED = 1000, 300, 100
SEEDS = 3

Figures = Iterator[tuple[str, Figure]]
Findings = Iterator[tuple[str, Figure | tuple[Curve, ...]]]


def learnt(
    crew: Crew, seed: int, method: str, scenario: str = "cut_in", **settings: Any
) -> list[Found]:
    """A campaign of training from each seed, with all else as it is by default."""
    return side_by_side(
        crew,
        [
            CampaignSpec(
                name=method,
                method=method,
                episodes=TRAINED,
                seed=seed + i,
                settings=settings,
                scenario=scenario,
            )
            for i in range(SEEDS)
        ],
    )


def ast(crew: Crew, seed: int) -> Findings:
    """AST: trained, evaluated, and its policy moved to other distances of the cut-in."""
    runs = learnt(crew, seed, "ast")
    yield "ast", tuple(map(curve, runs))
    place = f"cut_in.ast.train{TRAINED}"
    yield from rates(place, runs)
    yield "cut_in.ast.trained_episodes", middle(runs, trained, "episodes", TRAINED)
    yield "cut_in.ast.first_failure_episode", middle(runs, first_failure, "episode", TRAINED)
    yield from evaluated("cut_in.ast", evaluations(crew, runs, EVALUATED))
    usual_m = plugins.load(plugins.SCENARIOS, "cut_in").Parameters().distance_m
    for name, offset_m in {"plus5": 5.0, "minus5": -5.0}.items():
        moved = evaluations(crew, runs, MOVED, distance_m=usual_m + offset_m)
        yield f"cut_in.ast.{name}.failure_rate", middle(moved, failure_rate, "share", MOVED)


def cem(crew: Crew, seed: int) -> Findings:
    """The cross-entropy method."""
    runs = learnt(crew, seed, "cem")
    yield "cem", tuple(map(curve, runs))
    yield from rates(f"cut_in.cem.train{TRAINED}", runs)
    yield from evaluated("cut_in.cem", evaluations(crew, runs, EVALUATED))


def difs(crew: Crew, seed: int) -> Findings:
    """DiFS as it is by default."""
    runs = learnt(crew, seed, "difs")
    yield "difs", tuple(map(curve, runs))
    yield from rates(f"cut_in.difs.train{TRAINED}", runs)
    evaluated_runs = evaluations(crew, runs, EVALUATED)
    yield from evaluated("cut_in.difs", evaluated_runs)
    yield "cut_in.difs.logp_ratio", middle(evaluated_runs, log_p_ratio, "ratio", EVALUATED)
    yield "cut_in.difs.sample_std", middle(evaluated_runs, spread, "sigma", EVALUATED)


def merge(method: str, crew: Crew, seed: int) -> Figures:
    """How many failures a method finds where the truck merges; the sum over the seeds."""
    runs = learnt(crew, seed, method, "merge_in")
    found = [sum(one.crashed) for one in runs]
    yield (
        f"merge_in.{method}.failures",
        Figure(
            value=sum(found),
            unit="episodes",
            n=sum(len(one.crashed) for one in runs),
            spread=(min(found), max(found)),
            note=each(found),
            command=COMMAND,
        ),
    )


def rates(place: str, runs: Sequence[Found]) -> Figures:
    """The failure rate, and how likely the failures are."""
    n = len(runs[0].crashed)
    yield f"{place}.failure_rate", middle(runs, failure_rate, "share", n)
    yield f"{place}.log_p_per_step", middle(runs, log_p_per_step, "nat", n)


def evaluated(place: str, runs: Sequence[Found]) -> Figures:
    """The same of an evaluation, and how severe."""
    yield from rates(f"{place}.eval{EVALUATED}", runs)
    yield f"{place}.eval{EVALUATED}.mean_severity", middle(runs, severity, "m²/s²", EVALUATED)


def middle(runs: Sequence[Found], of: Callable[[Found], float | None], unit: str, n: int) -> Figure:
    """The median over the seeds, with all of them; no value unless each has one."""
    values = [of(run) for run in runs]
    known = sorted(value for value in values if value is not None)
    whole = len(known) == len(values)
    return Figure(
        value=median(known) if whole else None,
        unit=unit,
        n=n,
        spread=(known[0], known[-1]) if whole else None,
        note=each(values),
        command=COMMAND,
    )


def each(values: Sequence[float | None]) -> str:
    """The value of each seed, in their order."""
    told = ", ".join("–" if value is None else f"{value:.4g}" for value in values)
    return f"median of {len(values)} seeds: {told}"


def failure_rate(run: Found) -> float:
    """Failures ÷ episodes."""
    return rate(sum(run.crashed), len(run.crashed)).value


def first_failure(run: Found) -> float | None:
    """Number of the first episode that failed, from 1; None if none did."""
    return run.crashed.index(True) + 1.0 if any(run.crashed) else None


def trained(run: Found) -> float | None:
    """How many episodes the policy was trained on."""
    return None if run.trained_episodes is None else float(run.trained_episodes)


def severity(run: Found) -> float | None:
    """Mean over the failures."""
    return fmean(one.severity for one in run.crashes) if run.crashes else None


def log_p_per_step(run: Found) -> float | None:
    """Of the failures: log p over all of their steps ÷ steps."""
    steps = sum(len(one.z) for one in run.crashes)
    return sum(one.log_probability for one in run.crashes) / steps if steps else None


def log_p_ratio(run: Found) -> float | None:
    """log p of the failures ÷ what noise from p(x) has on average on the same steps."""
    if not run.crashes:
        return None
    usual = fsum(one.prior for one in run.crashes)
    return fsum(one.log_probability for one in run.crashes) / usual


def spread(run: Found) -> float:
    """Root mean square of z over all episodes: 1 for noise from p(x)."""
    return sqrt(run.mean_square_z)
