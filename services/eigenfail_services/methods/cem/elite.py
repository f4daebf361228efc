"""The elite of a round: the least robust episodes, and among many failures the likeliest."""

from collections.abc import Sequence
from math import isfinite

import numpy as np

from eigenfail.values import EpisodeResult, Floats
from eigenfail_services.methods.cem.proposal import Array, GaussianProposal, log_weights
from eigenfail_services.methods.robustness import robustness_m


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
    ran = [result for result in results if isfinite(robustness_m(result))]
    failures = [result for result in ran if result.is_failure]
    count = max(1, round(share * len(ran)))
    if len(failures) >= count:
        noise = [result.noise.z for result in failures]
        best = _lowest(noise, -log_weights(noise, proposal), count)
    else:
        noise = [result.noise.z for result in ran]
        best = _lowest(noise, np.array([robustness_m(result) for result in ran]), count)
    return best if len(best) < len(ran) else []


def _lowest(noise: Sequence[Floats], scores: Array, count: int) -> list[Floats]:
    """Those up to the score of the one that comes at `count`."""
    if not noise:
        return []
    last = np.sort(scores)[count - 1]
    return [z for z, score in zip(noise, scores, strict=True) if score <= last]
