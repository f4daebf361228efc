"""What passes between a method's learner and those who run its episodes."""

import msgspec

from eigenfail.values.arrays import Floats
from eigenfail.values.episode import EpisodeTask, Source
from eigenfail.values.policy import Policy


class LearnerContext(msgspec.Struct, frozen=True, eq=False):
    """What a learner is born with.

    Attributes:
        seed: of its own random draws.
        episodes: the campaign's budget.
        horizon: the number of steps of a full episode.
        trajectories: noise trajectories z to start from, shape (n, horizon, 2); n may be 0.
    """

    seed: int
    episodes: int
    horizon: int
    trajectories: Floats


class Proposal(msgspec.Struct, frozen=True, eq=False):
    """A round as a learner wants it.

    Attributes:
        sources: one for each episode, in index order.
        policy: the policy version that its policy sources name, if it is new.
    """

    sources: tuple[Source, ...]
    policy: Policy | None = None


class Round(msgspec.Struct, frozen=True, eq=False):
    """The episodes that a learner proposed from one state; observed together, in index order."""

    number: int
    tasks: tuple[EpisodeTask, ...]
    policy: Policy | None = None
