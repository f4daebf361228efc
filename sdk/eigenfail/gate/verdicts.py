"""Verdicts on a failure, from its outcome before and its outcome now."""

from collections.abc import Mapping
from enum import StrEnum
from typing import Generic, Protocol, TypeVar

import msgspec

from eigenfail.intervals import ERROR
from eigenfail.presentation.figures import format_count, format_signed, format_signed_interval
from eigenfail.values.campaign import Campaign, Counts
from eigenfail.values.comparison import Comparison, Difference, McNemar
from eigenfail.values.episode import Outcome
from eigenfail.values.estimates import Estimate

INFRASTRUCTURE = "infrastructure"


class GateVerdict(StrEnum):
    """Verdict on a failure under the new planner.

    `new`: it fails, and the baseline did not fail. `still failing`: both fail. `fixed`: only the
    baseline fails. `safe`: it does not fail, and the baseline is not known to fail or may have
    failed by chance. `unproven`: it fails, and the baseline's outcome is not known. `cannot be
    run`: the episode did not complete.
    """

    NEW = "new"
    STILL_FAILING = "still failing"
    FIXED = "fixed"
    SAFE = "safe"
    UNPROVEN = "unproven"
    CANNOT_RUN = "cannot be run"


CLOSING = frozenset({GateVerdict.NEW, GateVerdict.CANNOT_RUN})
"""What closes every gate."""

STRICTLY_CLOSING = CLOSING | {GateVerdict.STILL_FAILING, GateVerdict.UNPROVEN}


def judge_outcome(before: Outcome | None, now: Outcome | None) -> GateVerdict:
    """Return the verdict on an episode of both planners.

    Args:
        before: outcome with the baseline's planner; None if it is not known.
        now: outcome with the new planner; None without a result.
    """
    failed = before is not None and before.is_failure
    if now is Outcome.SAFE:
        return GateVerdict.FIXED if failed else GateVerdict.SAFE
    # Errored, or lost: whether the planner fails there is not known, so that it closes the gate.
    if now is None or not now.is_failure:
        return GateVerdict.CANNOT_RUN
    if before is Outcome.SAFE:
        return GateVerdict.NEW
    return GateVerdict.STILL_FAILING if failed else GateVerdict.UNPROVEN


class _EndedEpisode(Protocol):
    """An episode with its outcome."""

    @property
    def outcome(self) -> Outcome: ...


Row = TypeVar("Row", bound=_EndedEpisode)


class RunOutcomes(msgspec.Struct, Generic[Row], frozen=True):
    """The outcomes of a campaign's episodes; indices of safe episodes are not stored.

    Attributes:
        episodes: number of episodes with a result; their indices begin with 0.
        failures: failures by the index of the episode.
        errored: episodes that errored, by index.
        unresolved: safe episodes that are unresolved, by index.
    """

    episodes: int
    failures: dict[int, Row]
    errored: dict[int, Row]
    unresolved: dict[int, Row] = {}

    def of(self, index: int) -> Outcome | None:
        """Return the outcome of an episode; None if it was not run or errored."""
        if index in self.failures:
            return self.failures[index].outcome
        known = index < self.episodes and index not in self.errored
        return Outcome.SAFE if known else None


def judge_pairs(before: RunOutcomes[Row], now: RunOutcomes[Row]) -> dict[int, GateVerdict]:
    """Return the verdict on each episode that failed on either side, by index.

    Episodes that only the baseline tried, or that neither side could run, are left out.

    Args:
        before: outcomes of the baseline.
        now: outcomes of the new planner, under the same noise at every index.
    """
    tried = {index for index in before.failures if index < now.episodes}
    # Errored where the baseline got to its end: that alone may be the new planner's doing.
    broken = {index for index in now.errored if before.of(index) is not None}
    indices = sorted(tried | broken | now.failures.keys())
    found = {index: judge_outcome(before.of(index), now.of(index)) for index in indices}
    return {index: each for index, each in found.items() if each is not GateVerdict.SAFE}


def judge_doubtful(before: RunOutcomes[Row], now: RunOutcomes[Row]) -> dict[int, GateVerdict]:
    """Return the verdict on each episode in doubt if it failed, by index: the worst case.

    Errored and unresolved episodes are in doubt. An episode that is unresolved on both sides has
    not changed. An episode that errored on both sides may still hide a new failure.

    Args:
        before: outcomes of the baseline.
        now: outcomes of the new planner, under the same noise at every index.
    """
    unchanged = before.failures.keys() | (before.unresolved.keys() & now.unresolved.keys())
    found = {}
    for index in sorted(now.errored.keys() | now.unresolved.keys()):
        if index in unchanged:
            found[index] = GateVerdict.STILL_FAILING
        elif index < before.episodes:
            found[index] = GateVerdict.NEW
        else:
            found[index] = GateVerdict.UNPROVEN
    return found


def judge_rate(before: Campaign, now: Campaign, difference: Difference | None) -> GateVerdict:
    """Return the verdict on the failures of a campaign whose noise depends on its planner.

    New if the baseline found none and there are failures now, however few. Also new if the share of
    failures rose enough: Newcombe's 95 % interval of the difference lies above 0. That is beyond
    chance if both campaigns drew from p(x), and beyond a threshold of the gate if a search chose
    the episodes. If both campaigns estimate the failure probability with a 95 % interval, these two
    intervals replace Newcombe's: new if the interval now lies above the baseline's. An estimate
    that is only a lower bound of the probability is without an interval, and decides nothing.

    Fixed if the failures fell as far. Safe if they did not, but the new planner never fails. Cannot
    be run if episodes errored that the baseline completed. Otherwise still failing.
    """
    if has_new_errors(before.counts, now.counts):
        return GateVerdict.CANNOT_RUN
    change = find_change(before.estimate, now.estimate, difference)
    return _judge_change(before.counts.failures, now.counts.failures, change)


def has_new_errors(before: Counts, now: Counts) -> bool:
    """Return whether episodes errored that the baseline completed, as far as counts can show."""
    return now.all_errored or (bool(now.errored) and not before.errored)


def judge_rate_by_chance(pairs: McNemar | None, counts: Mapping[GateVerdict, int]) -> GateVerdict:
    """Return the verdict on all pairs of episodes together.

    New if episodes fail now and none failed before. Also new if more episodes began to fail than
    stopped failing, by more than chance: McNemar's exact test gives p < 0.05. Fixed if more stopped
    than began, by the same test. Safe if none fails now and chance explains the difference. Cannot
    be run if an episode cannot be run. Otherwise still failing.
    """
    # Errored first: the test is on the other pairs, and would hide what could not be run.
    if counts.get(GateVerdict.CANNOT_RUN) or pairs is None:
        return GateVerdict.CANNOT_RUN
    change = (pairs.only_b > pairs.only_a) - (pairs.only_b < pairs.only_a)
    beyond_chance = change if pairs.p_value < ERROR else 0
    return _judge_change(pairs.both + pairs.only_a, pairs.both + pairs.only_b, beyond_chance)


def _judge_change(before: int, now: int, change: int) -> GateVerdict:
    """Return the verdict on the failures as a whole.

    Args:
        before: number of failures of the baseline.
        now: number of failures of the new planner.
        change: 1 if they rose by more than the rule allows, -1 if they fell, else 0.
    """
    # A first failure is new however rare it is: no test could tell it from none.
    if not before:
        return GateVerdict.NEW if now else GateVerdict.SAFE
    return CHANGES[change] if change or now else GateVerdict.SAFE


CHANGES = {1: GateVerdict.NEW, 0: GateVerdict.STILL_FAILING, -1: GateVerdict.FIXED}


def find_change(
    before: Estimate | None, now: Estimate | None, difference: Difference | None
) -> int:
    """Return 1 if the failures rose beyond the gate's rule, -1 if they fell beyond it, else 0."""
    # An estimate weighs the failures of a search, so that it says more than their share.
    if ends := subtract_estimates(before, now):
        low, high = ends
    elif difference:
        low, high = difference.interval.low, difference.interval.high
    else:
        return 0
    # An interval that holds 0 decides nothing, in either direction.
    return (low > 0.0) - (high < 0.0)


def subtract_estimates(before: Estimate | None, now: Estimate | None) -> tuple[float, float] | None:
    """Return the smallest and the largest rise within both intervals; None if one is missing."""
    if before and now and before.interval and now.interval:
        low = now.interval.low - before.interval.high
        return low, now.interval.high - before.interval.low
    return None


COUNT_WORDS = {
    GateVerdict.SAFE: "none on either side",
    GateVerdict.CANNOT_RUN: "and some episodes errored, which the baseline completed",
}

CHANCE_WORDS = COUNT_WORDS | {
    GateVerdict.NEW: "more than chance explains",
    GateVerdict.STILL_FAILING: "consistent with chance",
    GateVerdict.FIXED: "fewer than chance explains",
}

THRESHOLD_WORDS = COUNT_WORDS | {
    GateVerdict.NEW: "a rise beyond the gate's threshold",
    GateVerdict.STILL_FAILING: "a difference within the gate's threshold",
    GateVerdict.FIXED: "a fall beyond the gate's threshold",
}
"""Of a search, whose interval is a threshold: its episodes are no random sample."""

ESTIMATE_WORDS = COUNT_WORDS | {
    GateVerdict.NEW: "the 95 % interval of the failure probability lies above the baseline's",
    GateVerdict.STILL_FAILING: "the 95 % intervals of the failure probability overlap",
    GateVerdict.FIXED: "the 95 % interval of the failure probability lies below the baseline's",
}


def join_counts(counts: Mapping[GateVerdict, int]) -> str:
    """Return the numbers of failures by verdict as text; empty if there are none."""
    return ", ".join(f"{format_count(count)} {verdict}" for verdict, count in counts.items())


def describe_pairs(counts: Mapping[GateVerdict, int], comparison: Comparison) -> str:
    """Return the verdict on pairs of episodes in words."""
    pairs = comparison.pairs
    if pairs is None:
        return comparison.unpaired_because
    named = join_counts(counts) or "no failure"
    discordant, chance = pairs.only_a + pairs.only_b, ""
    if discordant:
        chance = f" (McNemar's exact test on {discordant}: p = {pairs.p_value:.2g})"
    return f"{pairs.n} pairs of episodes under the same noise: {named}{chance}."


def describe_rates(
    verdict: GateVerdict, before: Campaign, now: Campaign, comparison: Comparison
) -> str:
    """Return the verdict on the failures of a campaign as a whole, in words."""
    was, counts = before.counts, now.counts
    shares = f"{counts.failures} of {counts.completed} fail, {was.failures} of {was.completed} did"
    if verdict is GateVerdict.NEW and not was.failures:
        return f"{shares}: the baseline had no failures, so every failure is new."
    if verdict is GateVerdict.SAFE and was.failures:
        few = "no fewer than chance explains" if comparison.is_sampled else WITHIN_THRESHOLD
        return f"{shares}: none now, though {few}{_describe_interval(comparison)}."
    words = CHANCE_WORDS if comparison.is_sampled else THRESHOLD_WORDS
    if subtract_estimates(before.estimate, now.estimate):
        words = ESTIMATE_WORDS
    return f"{shares}: {words[verdict]}{_describe_interval(comparison)}."


WITHIN_THRESHOLD = "the fall is within the gate's threshold"


def _describe_interval(comparison: Comparison) -> str:
    """Return the difference of the failure rates, with its interval if both samples are random."""
    found = comparison.difference
    if found is None:
        return ""
    difference = f"difference {format_signed(100.0 * found.value)} %"
    if not comparison.is_sampled:
        return f" ({difference}, without an interval: the method chose the episodes)"
    return f" ({difference} {format_signed_interval(found.interval, 100.0)})"
