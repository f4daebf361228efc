"""What a gate says of a campaign that was run again, in sentences."""

from collections.abc import Mapping

from eigenfail.gate.verdicts import Verdict
from eigenfail.values import Campaign, Comparison

RATE_WORDS = {
    Verdict.NEW: "more than chance explains",
    Verdict.STILL_FAILING: "no more and no less than chance explains",
    Verdict.FIXED: "fewer than chance explains",
    Verdict.SAFE: "none on either side",
    Verdict.CANNOT_RUN: "and some episodes cannot be run, which the baseline ran",
}


def of_pairs(counts: Mapping[Verdict, int], comparison: Comparison) -> str:
    """What became of pairs of episodes."""
    pairs = comparison.pairs
    if pairs is None:
        return comparison.unpaired_because
    named = ", ".join(f"{count} {each}" for each, count in counts.items()) or "no failure"
    return f"{pairs.n} pairs of episodes under the same noise: {named}{mcnemar(comparison)}."


def mcnemar(comparison: Comparison) -> str:
    """What chance says of pairs in which only one side failed."""
    pairs = comparison.pairs
    if pairs is None or not (pairs.only_a or pairs.only_b):
        return ""
    return f" (McNemar's exact test on {pairs.only_a + pairs.only_b}: p = {pairs.p_value:.2g})"


def of_rates(verdict: Verdict, before: Campaign, now: Campaign, comparison: Comparison) -> str:
    """What became of the failures of a campaign as a whole."""
    was, counts = before.counts, now.counts
    shares = f"{counts.failures} of {counts.completed} fail, {was.failures} of {was.completed} did"
    if verdict is Verdict.NEW and not was.failures:
        return f"{shares}: the baseline found none, so whatever is found is new."
    if verdict is Verdict.SAFE and was.failures:
        return f"{shares}: none now, though no fewer than chance explains{interval(comparison)}."
    return f"{shares}: {RATE_WORDS[verdict]}{interval(comparison)}."


def interval(comparison: Comparison) -> str:
    """The difference of the failure rates, with its interval."""
    found = comparison.difference
    if found is None:
        return ""
    value, low, high = (
        100.0 * share for share in (found.value, found.interval.low, found.interval.high)
    )
    return f" (difference {value:+.1f} % [{low:+.1f}, {high:+.1f}])"
