"""Why a campaign stops before its budget is spent, and in which words: pure."""

from collections.abc import Sequence

import msgspec

from eigenfail.values import EpisodeResult, Estimate, Outcome, StopRules
from eigenfail_services.statistics.intervals import wilson


class Tally(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What the rounds observed so far have shown."""

    completed: int = 0
    failures: int = 0

    def after(self, results: Sequence[EpisodeResult]) -> "Tally":
        """With another round."""
        completed = sum(result.outcome is not Outcome.FAILED for result in results)
        failures = sum(result.is_failure for result in results)
        return Tally(self.completed + completed, self.failures + failures)

    def half_width(self) -> float | None:
        """Half the width of the failure rate's 95 % Wilson interval; None before any episode."""
        if not self.completed:
            return None
        interval = wilson(self.failures, self.completed)
        return (interval.high - interval.low) / 2.0


def depends_on_results(rules: StopRules) -> bool:
    """Whether there are rules that are judged after each round."""
    return any(limit is not None for limit in (rules.failures, rules.half_width, rules.cv))


def by_results(rules: StopRules, tally: Tally, estimate: Estimate | None) -> str:
    """Why what was found is enough; empty if it is not."""
    width, cv = tally.half_width(), estimate.cv if estimate else None
    known = f"The failure rate is known to ± {shown(width)}"
    sure = f"The failure probability has a coefficient of variation of {shown(cv)}"
    return (
        _reached("failures", rules.failures, tally.failures, found(tally.failures))
        or _fell_to("half_width", rules.half_width, width, known)
        or _fell_to("cv", rules.cv, cv, sure)
    )


def by_time(rules: StopRules, active_s: float, cost_usd: float) -> str:
    """Why what was spent is enough; empty if it is not."""
    lasted, cost = f"It ran for {shown(active_s)} s", f"It cost {shown(cost_usd)} USD"
    return _reached("wall_s", rules.wall_s, active_s, lasted) or _reached(
        "cost_usd", rules.cost_usd, cost_usd, cost
    )


def found(failures: int) -> str:
    """How many failures there were."""
    return "1 failure was found" if failures == 1 else f"{failures} failures were found"


def shown(figure: float | None) -> str:
    """A figure in a sentence."""
    return "nothing" if figure is None else f"{figure:.4g}"


def _reached(name: str, limit: float | None, figure: float, words: str) -> str:
    holds = limit is not None and figure >= limit
    return f"{words} (rule: {name} = {limit})." if holds else ""


def _fell_to(name: str, limit: float | None, figure: float | None, words: str) -> str:
    holds = limit is not None and figure is not None and figure <= limit
    return f"{words} (rule: {name} = {limit})." if holds else ""
