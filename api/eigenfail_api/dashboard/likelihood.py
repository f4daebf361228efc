"""What the likelihood of noise is held against: typical noise, and none, over the same steps."""

from collections.abc import Iterable

import msgspec
import numpy as np

from eigenfail.contracts import Store
from eigenfail.errors import NoisePruned
from eigenfail.values import NoiseTrajectory
from eigenfail_services.campaigns.remembered import Remembered
from eigenfail_services.statistics.expected_likelihood import expected_log_probability

MOST_FAILURES = 8
"""Sigma follows the course of an episode, which differs little between failures."""

MOST_CAMPAIGNS = 500


class Reference(msgspec.Struct, frozen=True):
    """log p per step that other noise has over the steps of some failures, at their sigma.

    Attributes:
        typical: of noise drawn from p(x), on average. [nats]
        none: of no noise at all: none is likelier. [nats]
        failures: how many were looked at.
    """

    typical: float
    none: float
    failures: int


# An open page asks again and again for the same failures, whose noise never changes.
KNOWN: Remembered[Reference | None] = Remembered(MOST_CAMPAIGNS)


def reference_of(store: Store, campaign: int, failures: Iterable[int]) -> Reference | None:
    """Over the steps of failures by their indices; None without any, or where noise was pruned."""
    indices = tuple(failures)
    try:
        return KNOWN.get(store, campaign, indices, lambda: looked_up(store, campaign, indices))
    except NoisePruned:
        return None


def looked_up(store: Store, campaign: int, failures: Iterable[int]) -> Reference | None:
    """The same, from the noise that is stored.

    Raises:
        NoisePruned: it is not stored any more.
    """
    found = store.episodes.finished(campaign, failures)
    return reference([result.noise for result in found if result.steps])


def reference(noises: list[NoiseTrajectory]) -> Reference | None:
    """Over the steps of these; None of nothing."""
    steps = sum(len(noise.z) for noise in noises)
    if not steps:
        return None
    return Reference(
        typical=sum(map(expected_log_probability, noises)) / steps,
        none=sum(noise.log_probability for noise in map(stilled, noises)) / steps,
        failures=len(noises),
    )


def stilled(noise: NoiseTrajectory) -> NoiseTrajectory:
    """The same steps without noise."""
    return NoiseTrajectory(np.zeros_like(noise.z), noise.sigma, noise.shape)
