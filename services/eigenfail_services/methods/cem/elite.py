"""The elite of a round: the least robust episodes, and among many failures the likeliest."""

from collections.abc import Sequence
from math import isfinite, nan

import numpy as np

from eigenfail.values import EpisodeResult, Floats, Outcome
from eigenfail_services.methods.cem.proposal import Array, GaussianProposal, log_weights


def elite(
    results: Sequence[EpisodeResult], proposal: GaussianProposal, share: float
) -> list[Floats]:
    """The noise that a round's proposal is to learn from; empty where the round says nothing.

    While failures are fewer than the elite, it is made of the least robust episodes; after that, of
    the failures that are likeliest in view of how often the proposal draws them: by
    log p(z) − log q(z). By log p(z) alone, those of the smallest noise would be chosen even where
    noise does not matter, and the proposal would become narrower than failures are. Whoever ties
    with the last of the elite belongs to it, and an elite that is everybody says nothing.

    Args:
        results: of one round; episodes that failed to run are passed over.
        proposal: what their noise was drawn from.
        share: how many of the episodes that ran make the elite, at least one.
    """
    ran = [result for result in results if isfinite(_robustness(result))]
    failures = [result for result in ran if result.is_failure]
    count = max(1, round(share * len(ran)))
    if len(failures) >= count:
        noise = [result.noise.z for result in failures]
        best = _lowest(noise, -log_weights(noise, proposal), count)
    else:
        noise = [result.noise.z for result in ran]
        best = _lowest(noise, np.array([_robustness(result) for result in ran]), count)
    return best if len(best) < len(ran) else []


def _lowest(noise: Sequence[Floats], scores: Array, count: int) -> list[Floats]:
    """Those up to the score of the one that comes at `count`."""
    if not noise:
        return []
    last = np.sort(scores)[count - 1]
    return [z for z, score in zip(noise, scores, strict=True) if score <= last]


def _robustness(result: EpisodeResult) -> float:
    """0 on a collision, not a number where it is not known. [m]"""
    if result.is_failure:
        return 0.0
    if result.outcome is Outcome.FAILED or result.measures is None:
        return nan
    return result.measures.robustness_m
