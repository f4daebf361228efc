"""Failure modes that only the new planner has, among its failures and the baseline's together."""

from collections.abc import Iterator
from math import exp, lgamma
from typing import NamedTuple

import numpy as np
from msgspec.structs import replace

from eigenfail.gate.found import By, Rerun, finding
from eigenfail.gate.reruns import Side
from eigenfail.gate.verdicts import Verdict
from eigenfail.values import Analysis, AnalysisResult

NEW_MODE = 0.025
"""How often failures of the baseline's kind have a mode that is called new, at most: all modes of a
campaign together, each tested at an equal part of it (Bonferroni)."""

RARER = 10
"""So many times as often as before must failures be in a mode for it to be called new."""

NOT_JUDGED = (
    "That is told, not judged: failures of {} are not independent of each other, so that two runs"
    " of one planner may dwell in different modes."
)

ASKING = frozenset({Verdict.STILL_FAILING, Verdict.FIXED})


class NewMode(NamedTuple):
    """A mode that the new planner's failures are in, and the baseline's are not, or hardly.

    Attributes:
        number: of the mode, from 1.
        episode: of the new planner, its failure in the mode that is nearest to the centre.
        now: its failures in the mode, of `of_now`.
        before: the baseline's, of `of_before`.
        p_value: of Fisher's exact test, one-sided.
    """

    number: int
    episode: int
    now: int
    of_now: int
    before: int
    of_before: int
    p_value: float

    def words(self, judged: bool) -> str:
        """What it rests on; the chance of it is that of independent failures alone."""
        chance = f" (p = {self.p_value:.2g})" if judged else ""
        return (
            f"new mode {self.number}: {self.now} of {self.of_now} failures are in it, before"
            f" {self.before} of {self.of_before}{chance}"
        )


def asks_for_modes(judged: Rerun) -> bool:
    """Whether a new mode would say more: where the rate tells of nothing new."""
    failed = judged.before.failures and judged.now.failures
    return bool(judged.by is By.RATE and judged.verdict in ASKING and failed)


def with_modes(judged: Rerun, together: Analysis, now: Side, pages: str) -> Rerun:
    """A rerun with the failure modes that are new in it; if they count, it is new itself.

    Args:
        judged: by its rate.
        together: an analysis of the baseline's campaign and this one that has ended.
        now: the new planner's side.
        pages: address of the service's pages.
    """
    result = together.result
    if result is None or not result.distinct:
        reason = result.verdict if result else together.problem
        return replace(judged, modes=f"Whether a failure mode is new cannot be told: {reason}")
    new = [*new_modes(result, judged.before.campaign, judged.now.campaign)]
    if not new:
        words = f"None of {len(result.modes)} failure modes is new."
        return replace(judged, modes=words)
    counts, rows = judged.judges_modes, now.outcomes.collisions
    became = Verdict.NEW if counts else Verdict.UNPROVEN
    told = [(one.words(counts), rows.get(one.episode)) for one in new]
    sentence = f"{'; '.join(words for words, _ in told)}.".capitalize()
    return replace(
        judged,
        verdict=Verdict.NEW if counts else judged.verdict,
        modes=sentence if counts else f"{sentence} {NOT_JUDGED.format(judged.method)}",
        new_modes=tuple(finding(became, words, "", row, pages) for words, row in told),
    )


def new_modes(result: AnalysisResult, before: int, now: int) -> Iterator[NewMode]:
    """The modes that hold more of one campaign's failures than chance and the other's explain.

    The modes are found without regard to whose the failures are. So if those of both campaigns are
    independent draws of one kind, each mode has a random part of either's: Fisher's exact test
    (1935, The Design of Experiments) holds its error, however the modes were found.

    Args:
        result: of both campaigns' failures together.
        before: the baseline's campaign.
        now: the new planner's.
    """
    labels, campaigns = np.array(result.labels), np.array(result.campaigns)
    ours, theirs = campaigns == now, campaigns == before
    of_now, of_before = int(ours.sum()), int(theirs.sum())
    for place, mode in enumerate(result.modes):
        inside = labels == place
        k_now, k_before = int((inside & ours).sum()), int((inside & theirs).sum())
        p_value = no_fewer(k_now, of_now, k_now + k_before, of_now + of_before)
        is_rare = RARER * k_before * of_now <= k_now * of_before
        if k_now and is_rare and p_value < NEW_MODE / len(result.modes):
            rows = np.flatnonzero(inside & ours)
            away = np.linalg.norm(result.scores[rows] - mode.centre, axis=1)
            episode = result.episodes[rows[np.argmin(away)]]
            yield NewMode(place + 1, episode, k_now, of_now, k_before, of_before, p_value)


def no_fewer(k: int, drawn: int, marked: int, total: int) -> float:
    """The probability of k or more marked ones among some drawn of all without replacement."""
    most = min(drawn, marked)
    whole = log_ways(total, marked)
    logs = (
        log_ways(drawn, x) + log_ways(total - drawn, marked - x) - whole
        for x in range(max(k, marked - (total - drawn)), most + 1)
    )
    return min(1.0, sum(map(exp, logs)))


def log_ways(n: int, k: int) -> float:
    """Logarithm of the number of ways to choose k of n."""
    return lgamma(n + 1) - lgamma(k + 1) - lgamma(n - k + 1)
