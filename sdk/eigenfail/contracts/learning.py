"""What chooses disturbances: learners and the methods that make them."""

from collections.abc import Sequence
from typing import Any, ClassVar, Protocol, runtime_checkable

import msgspec

from eigenfail.values import EpisodeResult, Estimate, LearnerContext, Proposal, RoundSizes


class Learner(Protocol):
    """The running state of a method. Pure: no socket, no database, no clock.

    Attributes:
        lookahead: how many rounds may be open besides the oldest one; with 0, each round is
            proposed after all before it were observed; with 1, a policy is trained on rounds up to
            k-1 while round k runs.
    """

    lookahead: int

    def propose(self, n: int) -> Proposal:
        """The next round: at least one and at most n episodes; or none, to end the campaign."""

    def observe(self, results: Sequence[EpisodeResult]) -> None:
        """Learn from a whole round, in index order; failed episodes are among the results."""

    def state(self) -> bytes:
        """Everything needed to go on bit for bit, without pickle."""

    def restore(self, state: bytes) -> None:
        """Go on from such a state.

        Raises:
            ProtocolError: the bytes are not a state of this method.
        """


@runtime_checkable
class Exploiter(Protocol):
    """A learner whose knowledge can be used without learning on. No learner has to."""

    def exploit(self, n: int) -> Proposal:
        """Exactly n episodes from what is known now, drawn anew at each call."""


@runtime_checkable
class Estimator(Protocol):
    """A learner that can tell the failure probability under p(x). No learner has to."""

    def estimate(self) -> Estimate | None:
        """What is known after the last round observed; None before there is anything to tell."""


@runtime_checkable
class Trained(Protocol):
    """A learner that can tell how many episodes it was trained with. No learner has to."""

    @property
    def trained_episodes(self) -> int | None:
        """So far; it stands still once training has ended. None where it cannot be said."""


class Method(Protocol):
    """Makes learners; its `Settings` carry defaults and bounds."""

    Settings: ClassVar[type[msgspec.Struct]]

    def __call__(self, context: LearnerContext, settings: Any) -> Learner:
        """A new learner."""


@runtime_checkable
class Paced(Protocol):
    """A method that can tell how large its rounds are: stop rules are judged after whole ones.

    No method has to; one whose settings have a `round_size` is taken to keep to it.
    """

    @staticmethod
    def round_sizes(settings: Any, episodes: int, /) -> RoundSizes:
        """With these settings and so many episodes in all."""
