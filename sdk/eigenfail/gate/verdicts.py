"""What became of a failure: from what came of an episode before, and what comes of it now."""

from collections.abc import Mapping
from enum import StrEnum

import msgspec

from eigenfail.values import Campaign, Comparison, Counts, Estimate, Outcome
from eigenfail.values.records import EpisodeRow

INFRASTRUCTURE = "infrastructure"
ERROR = 0.05


class Verdict(StrEnum):
    """What became of a failure under the new planner.

    `new`: it fails, and the baseline did not. `still failing`: both fail. `fixed`: the baseline
    failed. `safe`: it does not fail, and nobody knows that the baseline did, or it may have been
    chance. `unproven`: it fails, and what the baseline did is not known. `cannot be run`: the
    episode did not get to its end.
    """

    NEW = "new"
    STILL_FAILING = "still failing"
    FIXED = "fixed"
    SAFE = "safe"
    UNPROVEN = "unproven"
    CANNOT_RUN = "cannot be run"


CLOSING = frozenset({Verdict.NEW, Verdict.CANNOT_RUN})
"""What closes every gate."""

STRICTLY_CLOSING = CLOSING | {Verdict.STILL_FAILING, Verdict.UNPROVEN}

FAILING = {Outcome.COLLISION: Verdict.STILL_FAILING, Outcome.SAFE: Verdict.NEW}
PASSING = {Outcome.COLLISION: Verdict.FIXED}


def verdict(before: Outcome | None, now: Outcome | None) -> Verdict:
    """What became of an episode that both planners were given.

    Args:
        before: what came of it with the baseline's planner; None if that is not known.
        now: what came of it with the new one; None if there is no result.
    """
    if now is Outcome.COLLISION:
        return FAILING.get(before, Verdict.UNPROVEN) if before else Verdict.UNPROVEN
    if now is Outcome.SAFE:
        return PASSING.get(before, Verdict.SAFE) if before else Verdict.SAFE
    return Verdict.CANNOT_RUN


class Outcomes(msgspec.Struct, frozen=True):
    """What came of a campaign's episodes, without naming the safe ones.

    Attributes:
        episodes: those with a result, which have the indices from 0.
        collisions: by index.
        failed: those that could not be run, by index.
    """

    episodes: int
    collisions: dict[int, EpisodeRow]
    failed: dict[int, EpisodeRow]

    def of(self, index: int) -> Outcome | None:
        """What came of one; None where it was not tried or could not be run."""
        if index in self.collisions:
            return Outcome.COLLISION
        known = index < self.episodes and index not in self.failed
        return Outcome.SAFE if known else None


def paired(before: Outcomes, now: Outcomes) -> dict[int, Verdict]:
    """What became of each episode that failed on a side, by index.

    Episodes that only the baseline tried, or that neither could run, are left out.

    Args:
        before: of the baseline.
        now: of the new planner, under the same noise at every index.
    """
    tried = {index for index in before.collisions if index < now.episodes}
    broken = {index for index in now.failed if before.of(index) is not None}
    indices = sorted(tried | broken | now.collisions.keys())
    found = {index: verdict(before.of(index), now.of(index)) for index in indices}
    return {index: each for index, each in found.items() if each is not Verdict.SAFE}


def by_rate(before: Campaign, now: Campaign, comparison: Comparison) -> Verdict:
    """What became of the failures of a campaign whose noise depends on what its planner does.

    New where the baseline found none, however few there are now, or where the failure rate rose by
    more than chance: where Newcombe's 95 % interval of the difference lies above 0; where both
    campaigns estimate the failure probability, where the two 95 % intervals do not meet. Fixed, if
    it fell so far; safe, if there is no failure now, and by chance there may have been none before.
    """
    if broke(before.counts, now.counts):
        return Verdict.CANNOT_RUN
    if not before.counts.failures:
        return Verdict.NEW if now.counts.failures else Verdict.SAFE
    changed = change(before.estimate, now.estimate, comparison)
    return CHANGES[changed] if changed or now.counts.failures else Verdict.SAFE


def broke(before: Counts, now: Counts) -> bool:
    """Whether episodes cannot be run any more."""
    return bool(now.failed) and not before.failed


def by_chance(comparison: Comparison, counts: Mapping[Verdict, int]) -> Verdict:
    """What became of all pairs of episodes together.

    New where none failed before, or where more of them fail newly than no longer, by more than
    chance: where McNemar's exact test on them gives p < 0.05. Fixed, if it is the other way round;
    safe, if none fails now, and no fewer than chance explains.
    """
    pairs = comparison.pairs
    if counts.get(Verdict.CANNOT_RUN) or pairs is None:
        return Verdict.CANNOT_RUN
    if not (pairs.both or pairs.only_a):
        return Verdict.NEW if pairs.only_b else Verdict.SAFE
    beyond = pairs.p_value < ERROR
    changed = beyond * ((pairs.only_b > pairs.only_a) - (pairs.only_b < pairs.only_a))
    return CHANGES[changed] if changed or pairs.both or pairs.only_b else Verdict.SAFE


CHANGES = {1: Verdict.NEW, 0: Verdict.STILL_FAILING, -1: Verdict.FIXED}


def change(before: Estimate | None, now: Estimate | None, comparison: Comparison) -> int:
    """1 where failures became likelier beyond chance, -1 where less likely, 0 otherwise."""
    if before and now and before.interval and now.interval:
        low = now.interval.low - before.interval.high
        high = now.interval.high - before.interval.low
    elif comparison.difference:
        low, high = comparison.difference.interval.low, comparison.difference.interval.high
    else:
        return 0
    return (low > 0.0) - (high < 0.0)
