"""Contracts of the parts that choose disturbances: learners, and methods that make learners."""

from collections.abc import Mapping, Sequence
from enum import StrEnum
from types import MappingProxyType
from typing import Any, ClassVar, Protocol, runtime_checkable

import msgspec

from eigenfail.values.episode import EpisodeResult
from eigenfail.values.estimates import Estimate
from eigenfail.values.learning import LearnerContext, Proposal, RoundSizes


class Learner(Protocol):
    """State of a running method. Pure: without socket, database and clock.

    Attributes:
        lookahead: number of rounds that may be open besides the oldest one. With 0, each round is
            proposed after all earlier rounds were observed. With 1, a policy is trained on rounds
            up to k-1 while round k runs. It may change with each proposal and observation: 0 while
            the next round waits for the results of open rounds.
    """

    lookahead: int

    def propose(self, n: int) -> Proposal:
        """Return the next round: one to n episodes, or none to end the campaign."""

    def observe(self, results: Sequence[EpisodeResult]) -> None:
        """Learn from the results of a complete round in index order, errored episodes included."""

    def state(self) -> bytes:
        """Return a state, not pickled, that `restore` continues from bit for bit."""

    def restore(self, state: bytes) -> None:
        """Restore a state of `state`.

        Raises:
            ProtocolError: the bytes are not a state of this method.
        """


@runtime_checkable
class Exploiter(Protocol):
    """Optional: a learner that can be used without learning more."""

    def exploit(self, n: int) -> Proposal:
        """Return exactly n episodes from the present knowledge; each call draws new ones."""


@runtime_checkable
class Estimator(Protocol):
    """Optional: a learner that estimates the failure probability under p(x)."""

    def estimate(self) -> Estimate | None:
        """Return the estimate after the last observed round; None without one."""


@runtime_checkable
class Trained(Protocol):
    """Optional: a learner that reports the number of episodes that it was trained with."""

    @property
    def trained_episodes(self) -> int | None:
        """Number of training episodes, constant after the end of training; None if unknown."""


class Reference(StrEnum):
    """Part of an earlier campaign or analysis that a method uses; its settings name which one."""

    NOISE = "noise"
    """Noise trajectories to inject again."""

    EPISODES = "episodes"
    """Noise and robustness of completed episodes as training data."""

    LEARNER = "learner"
    """The learner of a campaign of any method that implements `Exploiter`."""

    OWN_LEARNER = "own learner"
    """The learner of a campaign of the same method, whose training continues."""


class Injection(StrEnum):
    """Recorded noise that a method needs."""

    NOTHING = "nothing"
    TRAJECTORIES = "trajectories"
    ONE_FAILURE = "one failure"
    FAILURES = "failures"
    """Those of an ended campaign, with episodes of as many steps."""


class ModeProbability(StrEnum):
    """Way to find the probability of a failure mode from a campaign's episodes."""

    UNKNOWN = "unknown"
    COUNTS = "counts"
    """By counting failures: all noise is drawn from p(x)."""

    WEIGHTS = "weights"
    """By importance weights of a learner that goes through the campaign again."""

    KNOWN_PROPOSAL = "known proposal"
    """By importance weights of a proposal that does not change."""

    LEVELS = "levels"
    """By the last level of a subset simulation."""


class MethodTraits(msgspec.Struct, frozen=True, kw_only=True):
    """Declaration of a method's properties, as `traits` of its class; default: the values below.

    Attributes:
        draws_from_prior: whether all noise is drawn from p(x), the prior, so that the share of
            failures is a failure rate.
        independent: whether its episodes are independent draws of one distribution, p(x) or
            another one, so that means over them have an interval.
        bounds_probability: whether it estimates P(failure) itself, with a log-normal interval, if
            `draws_from_prior` is false.
        learns: whether its proposals improve with the results of earlier episodes.
        observes: whether its learner uses the results of episodes. If not, the learner receives
            only index, seed, source, outcome and steps of each, without measures and noise.
        finds_new: whether its failures are new, rather than repeated from earlier campaigns.
        is_evidence: whether its episodes are evidence, which pruning keeps.
        pairable: whether episodes of equal seed and settings have the same noise, independent of
            earlier results.
        tolerates_delay: whether it keeps as many rounds open as `parallel` of its context needs.
            Proposals then do not wait for the results of the last rounds; proposals of chains wait
            only for their own chains.
        has_members: whether its settings name the `method` and `settings` of several learners.
        needs_course: whether it continues episodes from one of their steps. Functions do not have
            steps to continue from, and the scenario must be the same in each episode.
        injects: recorded noise that it needs.
        mode_probability: way to find the probability of a failure mode.
        chart_mark: index of its colour and shape in charts; None derives one from its name.
        references: settings that name earlier campaigns or analyses, with the part it uses.
            Only `analysis` or `campaign` can name noise. If `analysis` names noise, `mode`,
            `modes` and `what` select it; if `campaign` does, `episode` and `episodes` select it:
            see the settings of `replay` and `minimal`. A method that declares no references may use
            all these names freely: then only values that a user gives count, and only ids.
    """

    draws_from_prior: bool = False
    independent: bool = False
    bounds_probability: bool = False
    # The defaults claim nothing: a method has to declare what makes its figures stronger.
    learns: bool = True
    observes: bool = True
    finds_new: bool = True
    is_evidence: bool = False
    pairable: bool = False
    tolerates_delay: bool = False
    has_members: bool = False
    needs_course: bool = False
    injects: Injection = Injection.NOTHING
    mode_probability: ModeProbability = ModeProbability.UNKNOWN
    chart_mark: int | None = None
    # A method that declares none is understood by these names of settings.
    references: Mapping[str, Reference] = MappingProxyType(
        {
            "analysis": Reference.NOISE,
            "campaign": Reference.NOISE,
            "data_from": Reference.EPISODES,
        }
    )


class Method(Protocol):
    """Maker of learners; its `Settings` carry defaults and bounds.

    It may declare `traits`, see `MethodTraits`.
    """

    Settings: ClassVar[type[msgspec.Struct]]

    def __call__(self, context: LearnerContext, settings: Any) -> Learner:
        """Return a new learner."""


@runtime_checkable
class Paced(Protocol):
    """Optional: a method that reports the size of its rounds, after which stop rules are checked.

    For other methods, the setting `round_size` is used if it exists.
    """

    @staticmethod
    def round_sizes(settings: Any, episodes: int, /) -> RoundSizes:
        """Return the sizes of rounds for the settings and the total number of episodes."""
