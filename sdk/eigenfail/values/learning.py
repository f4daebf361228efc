"""What passes between a method's learner and those who run its episodes."""

from typing import Any

import msgspec

from eigenfail.values.arrays import Floats
from eigenfail.values.episode import EpisodeTask, Source
from eigenfail.values.policy import Policy


class Predecessor(msgspec.Struct, frozen=True, eq=False):
    """The learner of an earlier campaign: what it was born with, and what it knew in the end.

    Attributes:
        campaign: its id.
        method: its method, by name.
        settings: the method's settings, as given.
        seed: of its learner's random draws.
        episodes: its campaign's budget.
        horizon: the number of steps of its episodes.
        state: what `Learner.state` last gave.
    """

    campaign: int
    method: str
    settings: dict[str, Any]
    seed: int
    episodes: int
    horizon: int
    state: bytes


class Experience(msgspec.Struct, frozen=True, eq=False):
    """What episodes of earlier campaigns taught: noise and robustness.

    Attributes:
        z: noise trajectories, zero behind an episode's end, shape (n, horizon, 2). [sigma]
        steps: of each episode, shape (n,).
        robustness_m: of each episode, shape (n,).
    """

    z: Floats
    steps: Floats
    robustness_m: Floats


class LearnerContext(msgspec.Struct, frozen=True, eq=False):
    """What a learner is born with.

    Attributes:
        seed: of its own random draws.
        episodes: the campaign's budget.
        horizon: the number of steps of a full episode.
        trajectories: noise trajectories z to start from, shape (n, horizon, 2); n may be 0.
        predecessors: learners of earlier campaigns that the settings name.
        experience: of earlier campaigns that the settings name; None if they name none.
    """

    seed: int
    episodes: int
    horizon: int
    trajectories: Floats
    predecessors: tuple[Predecessor, ...] = ()
    experience: Experience | None = None

    def predecessor(self, campaign: int) -> Predecessor | None:
        """The learner of that campaign, if it is at hand."""
        return next((one for one in self.predecessors if one.campaign == campaign), None)


class Proposal(msgspec.Struct, frozen=True, eq=False):
    """A round as a learner wants it.

    Attributes:
        sources: one for each episode, in index order.
        policy: the policy version that its policy sources name, if it is new.
    """

    sources: tuple[Source, ...]
    policy: Policy | None = None


class RoundSizes(msgspec.Struct, frozen=True):
    """How large the rounds of a method are, as far as its settings and the budget say.

    Attributes:
        first: episodes of the first one.
        later: episodes of the largest one after that.
        setting: name of the setting that makes them smaller.
    """

    first: int
    later: int
    setting: str = "round_size"


class Round(msgspec.Struct, frozen=True, eq=False):
    """The episodes that a learner proposed from one state; observed together, in index order."""

    number: int
    tasks: tuple[EpisodeTask, ...]
    policy: Policy | None = None
