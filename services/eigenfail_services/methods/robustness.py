"""What the methods that go down to failures by robustness go by."""

from math import nan

from eigenfail.values import EpisodeResult, Outcome


def robustness_m(result: EpisodeResult) -> float:
    """0 on a collision, not a number where it is not known. [m]"""
    if result.is_failure:
        return 0.0
    if result.outcome is Outcome.FAILED or result.measures is None:
        return nan
    return result.measures.robustness_m
