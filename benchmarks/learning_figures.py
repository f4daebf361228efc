"""What is told of a campaign in one number, and of several campaigns in one figure."""

from collections.abc import Callable, Mapping, Sequence
from math import fsum, sqrt
from statistics import fmean, median

from figures import Figure
from heuristics import Tried, rate_at
from samples import COMMAND
from searches import Found

from eigenfail_services.statistics.intervals import rate


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


def deviation(run: Found) -> float:
    """Root mean square of z over all episodes: 1 for noise from p(x)."""
    return sqrt(run.mean_square_z)


def over_heuristics(run: Found, tried: Mapping[str, Sequence[Tried]]) -> float | None:
    """Failure rate ÷ that of the strongest shape that is as likely; None if none ever fails."""
    strongest = max(rate_at(found, run.log_p_per_step) for found in tried.values())
    return failure_rate(run) / strongest if strongest else None
