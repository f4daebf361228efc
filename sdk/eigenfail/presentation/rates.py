"""Words for failure rates under p(x), and for the way they are estimated."""

from collections.abc import Iterable, Mapping

from eigenfail.presentation import figures
from eigenfail.values.estimates import Rate, RateDesign

NO_ESTIMATE = (
    "With the stop rule `failures` no estimate without bias is of use at this end (it would be 0, "
    "as with `failures = 1`): the failure rate is given by its interval alone, which is exact for "
    "the rule."
)

RULE_NOT_MET = (
    "The stop rule `failures` ended none of these episodes: the failure rate is failures ÷ "
    "episodes, which over all ends that the rule allows is without bias, with the exact interval "
    "of Clopper and Pearson."
)

SENTENCES: Mapping[RateDesign, str] = {
    RateDesign.FIXED: "",
    RateDesign.FAILURES: (
        "The failure rate is not failures ÷ episodes, which the stop rule `failures` makes too "
        "large on average, but the estimate without bias for this rule; its interval is exact."
    ),
    RateDesign.SEQUENCE: (
        "A stop rule judged the failures while they came in: the failure rate is failures ÷ "
        "episodes, which is biased then, with a confidence sequence, an interval that holds at "
        "whatever round a campaign ended. Quote the interval."
    ),
}

BASES: Mapping[RateDesign, tuple[str, ...]] = {
    RateDesign.FIXED: (),
    RateDesign.FAILURES: ("estimate for the stop rule",),
    RateDesign.SEQUENCE: ("confidence sequence",),
}


FAILURE_RATE = "Failure rate"
FAILED_SHARE = "Share of episodes that failed"


def name_rates(rates: Iterable[Rate | None]) -> str:
    """Return the heading of shares of failures, in sentence case.

    The share of failures among episodes that a search chose is not a failure rate. If one of the
    shares is from a search, the heading says so for all of them.
    """
    searched = any(rate is not None and not rate.sampled for rate in rates)
    return FAILED_SHARE if searched else FAILURE_RATE


def format_rate(rate: Rate) -> str:
    """Return the estimate of a rate and its interval in percent, or the part that is known.

    See `format_counted_rate` for a rate with its number of episodes.
    """
    if rate.interval is None:
        return figures.format_share(rate.value)
    if rate.value is None:
        return figures.format_percent_interval(rate.interval)
    return f"{figures.format_share(rate.value)} {figures.format_interval(rate.interval, 100.0)}"


def format_counted_rate(rate: Rate) -> str:
    """Return a rate of a random sample with its numbers of episodes."""
    # Without an event the estimate is 0, which says less than its upper bound.
    if not rate.k and rate.interval is not None:
        return f"{count_trials(rate)}: {figures.format_upper_bound(rate.interval.high)}"
    return f"{format_rate(rate)} of {count_completed(rate)}"


def count_trials(rate: Rate) -> str:
    """Return the events and episodes of a rate, with the number of episodes that may hide one."""
    return f"{rate.k:,} of {count_completed(rate)}"


def list_doubtful(errored: int, unresolved: int) -> str:
    """Return the episodes that may hide a failure, in words; empty if there is none."""
    doubtful = _count_doubtful(errored, unresolved)
    if not doubtful:
        return ""
    return f"{' and '.join(doubtful)} {'episode' if errored + unresolved == 1 else 'episodes'}"


def count_completed(rate: Rate) -> str:
    """Return a rate's completed episodes, with the number of episodes that may hide an event."""
    return ", ".join([f"{rate.n:,}", *_count_doubtful(rate.errored, rate.unresolved)])


def _count_doubtful(errored: int, unresolved: int) -> list[str]:
    # Either may hide an event: a count without them would look more certain than it is.
    counts = {"errored": errored, "unresolved": unresolved}
    return [f"{count:,} {word}" for word, count in counts.items() if count]


def explain_design(rate: Rate) -> str:
    """Return a sentence on how a rate is estimated if a stop rule judged failures.

    It is empty for a fixed number of episodes, and if none failed, which leaves an upper bound.
    """
    if not rate.k or rate.design is not RateDesign.FAILURES:
        return SENTENCES[rate.design] if rate.k else ""
    if rate.value is None:
        return NO_ESTIMATE
    return RULE_NOT_MET if rate.value == rate.share else SENTENCES[rate.design]
