"""What is told of a campaign in one number, and of several campaigns in one figure."""

from collections.abc import Callable, Mapping, Sequence
from math import fsum, sqrt
from statistics import fmean, median

from benchmarks.figures import Figure
from benchmarks.samples import COMMAND
from benchmarks.searches import Found
from benchmarks.truth.heuristics import Tried, rate_at

from eigenfail.intervals import difference
from eigenfail_services.statistics.intervals import rate


def middle(runs: Sequence[Found], of: Callable[[Found], float | None], unit: str, n: int) -> Figure:
    """The median over the seeds, with all of them; no value unless each has one."""
    return of_seeds([of(run) for run in runs], unit, n)


def of_seeds(values: Sequence[float | None], unit: str, n: int, more: str = "") -> Figure:
    """The median of one value for each seed; `more` follows them in the note."""
    known = sorted(value for value in values if value is not None)
    whole = len(known) == len(values)
    return Figure(
        value=median(known) if whole else None,
        unit=unit,
        n=n,
        spread=(known[0], known[-1]) if whole else None,
        note=each(values) + more,
        command=COMMAND,
    )


def each(values: Sequence[float | None], figure: str = "median") -> str:
    """The value of each seed, in their order, of which another one is the median or the sum."""
    told = ", ".join("–" if value is None else f"{value:.4g}" for value in values)
    return f"{figure} of {len(values)} seeds: {told}"


def failure_rate(run: Found) -> float:
    """Failures ÷ episodes."""
    return rate(sum(run.crashed), len(run.crashed)).value


def first_failure(run: Found) -> float | None:
    """Number of the first episode that failed, from 1; None if none did."""
    return run.crashed.index(True) + 1.0 if any(run.crashed) else None


def count_trained(run: Found) -> float | None:
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


def likelier(runs: Sequence[Found], others: Sequence[Found]) -> Figure:
    """log p per step of the failures less that of the others', seed by seed; above 0: likelier."""
    gains = [
        None if one is None or other is None else one - other
        for one, other in zip(map(log_p_per_step, runs), map(log_p_per_step, others), strict=True)
    ]
    rates = (", ".join(f"{failure_rate(run):.3g}" for run in side) for side in (runs, others))
    return of_seeds(gains, "nat", len(gains), f"; failure rates {' and '.join(rates)}")


def rate_gained(runs: Sequence[Found], others: Sequence[Found]) -> Figure:
    """The others' failure rate less that of the runs, over all seeds, with Newcombe's interval."""
    rates = [rate(*count_failures(side)) for side in (runs, others)]
    found = difference(*rates)
    told = " less ".join(f"{one.k} of {one.n}" for one in reversed(rates))
    return Figure(
        value=found.value,
        unit="share",
        n=sum(one.n for one in rates),
        interval=(found.interval.low, found.interval.high),
        note=f"{told}; Newcombe's 95 % interval",
        command=COMMAND,
    )


def count_failures(runs: Sequence[Found]) -> tuple[int, int]:
    """Failures and episodes over all seeds."""
    return sum(sum(run.crashed) for run in runs), sum(len(run.crashed) for run in runs)


def deviation(run: Found) -> float:
    """Root mean square of z over all episodes: 1 for noise from p(x)."""
    return sqrt(run.mean_square_z)


def over_heuristics(run: Found, tried: Mapping[str, Sequence[Tried]]) -> float | None:
    """Failure rate ÷ that of the strongest shape that is as likely; None if none ever fails."""
    strongest = max(rate_at(found, run.log_p_per_step) for found in tried.values())
    return failure_rate(run) / strongest if strongest else None
