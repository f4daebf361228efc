"""The methods: pure learners that choose disturbances, testable without services."""

from math import nan
from typing import Annotated, Any, Protocol, runtime_checkable

from msgspec import Meta

from eigenfail.values.campaign import Campaign
from eigenfail.values.episode import EpisodeResult, Outcome
from eigenfail.values.estimates import ChainMixing

# Types of settings that several methods have.
Id = Annotated[int, Meta(ge=1)]
Amount = Annotated[int, Meta(ge=1, le=100_000)]
UpToOne = Annotated[float, Meta(gt=0.0, le=1.0)]
UpToTen = Annotated[float, Meta(gt=0.0, le=10.0)]
RoundSize = Annotated[Amount, Meta(description="episodes in a round")]
Hold = Annotated[int, Meta(ge=1, le=10_000, description="steps for which a value is held")]


@runtime_checkable
class Budgeted(Protocol):
    """Settings with a minimum budget."""

    def check_budget(self, episodes: int) -> None:
        """Raise InvalidValue if the budget is too small."""


@runtime_checkable
class Particular(Protocol):
    """Settings that may prevent an estimate."""

    def no_estimate(self) -> str:
        """Return the reason for a missing estimate, with a remedy; empty if an estimate exists."""


@runtime_checkable
class Reaching(Protocol):
    """Settings of a method that cannot choose every disturbance."""

    def reach(self) -> str:
        """Return the largest disturbance that the method can choose, and how to exceed it."""


@runtime_checkable
class BurningIn(Protocol):
    """Settings of a method whose early failures are not samples of its target."""

    def first_sample(self, episodes: int) -> int:
        """Return the index of the first episode whose failure is a sample."""


@runtime_checkable
class Mixing(Protocol):
    """Class of a method that moves Markov chains from failure to failure."""

    @staticmethod
    def judge_mixing(campaign: Campaign, state: bytes) -> ChainMixing | None:
        """Return how far chains have mixed, from a learner's state; None before chains start."""


def find_first_sample(settings: Any, episodes: int) -> int:
    """Return the index of the first episode whose failure counts; 0 if all failures count."""
    return settings.first_sample(episodes) if isinstance(settings, BurningIn) else 0


def check_budget(settings: Any, episodes: int) -> None:
    """Raise InvalidValue for a budget that is too small for a method."""
    if isinstance(settings, Budgeted):
        settings.check_budget(episodes)


def describe_reach(settings: Any) -> str:
    """Describe the limits of a method's disturbances; empty if it can choose all disturbances."""
    return settings.reach() if isinstance(settings, Reaching) else ""


def robustness_m(result: EpisodeResult) -> float:
    """Return the robustness: 0 for a failure, NaN if unknown. [m]"""
    if result.is_failure:
        return 0.0
    # NaN, not infinity: an episode that could not be run is not safe, and must not rank as if it
    # were.
    if result.outcome is Outcome.ERRORED or result.measures is None:
        return nan
    return result.measures.robustness_m
