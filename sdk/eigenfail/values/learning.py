"""Values that pass between a method's learner and the runners of its episodes."""

from math import ceil
from typing import Any

import msgspec

from eigenfail.values.arrays import Floats
from eigenfail.values.episode import EpisodeTask, Source, TrajectorySource

STATE = (
    "gap_x",  # longitudinal distance from ego to actor, per 100 m
    "gap_y",  # lateral distance from ego to actor, per 4 m
    "ego_speed",  # per 30 m/s
    "actor_speed",  # per 30 m/s
    "actor_heading",  # [rad]
    "noise_x",  # longitudinal z of the step before, per 3 sigma; 0 at the start
    "noise_y",  # lateral z of the step before, per 3 sigma
    "progress",  # share of the episode's steps that has passed
)
"""Components of the adversary's state at each step, in order.

The last noise is among them because a tracker remembers it, and the adversary does not see the
tracker. Without it, the same action in the same state would fool the planner only sometimes.
"""


SCENE_STATE = STATE.index("noise_x")
"""Number of components of `STATE` before the components of the noise."""


def count_state(channels: int) -> int:
    """Return the number of components of the adversary's state with that many channels of noise.

    The state is `STATE`, with a component for the last z of each channel in place of `noise_x` and
    `noise_y`.
    """
    return SCENE_STATE + channels + 1


class Layer(msgspec.Struct, frozen=True, eq=False):
    """An affine layer: weight of shape (out, in), bias of shape (out,)."""

    weight: Floats
    bias: Floats


class Policy(msgspec.Struct, frozen=True, eq=False):
    """A squashed Gaussian: z = amplitude · tanh(mean(h) + exp(log_std(h)) · eps), h = ReLU layers.

    Attributes:
        version: number that counts up within a campaign.
        hidden: layers, each followed by a ReLU.
        mean: output layer for the mean of the action before the squashing.
        log_std: output layer for its log standard deviation, clamped to [-20, 2].
        amplitude: the largest |z| that the policy can choose. [sigma]
        hold: number of steps for which the policy keeps an action.
    """

    version: int
    hidden: tuple[Layer, ...]
    mean: Layer
    log_std: Layer
    amplitude: float
    hold: int


class Predecessor(msgspec.Struct, frozen=True, eq=False):
    """The learner of an earlier campaign: its context at the start, and its state at the end.

    Attributes:
        campaign: id of the campaign.
        method: name of its method.
        settings: the method's settings, as given.
        seed: seed of the learner's random draws.
        episodes: budget of the campaign.
        horizon: number of steps of its episodes.
        state: last value of `Learner.state`.
    """

    campaign: int
    method: str
    settings: dict[str, Any]
    seed: int
    episodes: int
    horizon: int
    state: bytes


class Experience(msgspec.Struct, frozen=True, eq=False):
    """The experience from episodes of earlier campaigns: noise and robustness.

    Attributes:
        z: noise trajectories, zero after an episode's end, shape (n, horizon, channels). [sigma]
        steps: number of steps of each episode, shape (n,).
        robustness_m: robustness of each episode, shape (n,).
    """

    z: Floats
    steps: Floats
    robustness_m: Floats


IN_FLIGHT = 1.5
"""Episodes that are proposed and not yet observed, per episode that is to run at a time. They are
either under way, or their round waits for its slowest episode. With more, `ast` runs more episodes
of old policies: with 1.75, it found 0.878 times the failures that it finds in two rounds of ten.
This was measured on its first 1000 episodes on `cut_in` with 100 at a time."""

MOST_OPEN_ROUNDS = 64

MOST_POLICIES = 2 * MOST_OPEN_ROUNDS
"""Policy versions that a worker keeps for a campaign: twice as many as can be open. An old version,
which an episode needs when it runs again, then does not displace a version in use."""


def count_rounds_ahead(parallel: int | None, round_size: int, least: int) -> int:
    """Return how many rounds to keep open besides the oldest one.

    Args:
        parallel: number of episodes to run at a time; None if the campaign does not set it.
        round_size: number of episodes in a round.
        least: number of rounds besides the oldest one that the method keeps open by default.
    """
    wanted = ceil(IN_FLIGHT * parallel / round_size) - 1 if parallel else 0
    return max(least, wanted)


CHAINS_IN_FLIGHT = 3.0
"""As `IN_FLIGHT`, for methods that move chains: late results cost them nothing. In a simulation
with `subset`, 20,000 episodes, P = 1e-4 and 100 workers, 0.98 of the workers were busy with 1.5 and
with 3 if every episode takes 1 s. If durations vary by 20 % (log-normal), 0.88 of the workers were
busy with 1.5, and 0.96 with 3."""

OPEN_GROUPS = 12
"""Groups of chains, each a round, that are open at a time. With half as many groups of twice the
size, more chains wait for the last one of their group. More groups would cost the service too much
time: each round costs it milliseconds."""

FEWEST_TOGETHER = 5
"""Smallest number of chains in a group, for any number of workers."""


def choose_group_size(parallel: int) -> int:
    """Return the largest number of chains that move together, for `parallel` open episodes."""
    return max(ceil(CHAINS_IN_FLIGHT * parallel / OPEN_GROUPS), FEWEST_TOGETHER)


class LearnerContext(msgspec.Struct, frozen=True, eq=False):
    """The context for creating a learner.

    Attributes:
        seed: seed of the learner's random draws.
        episodes: the campaign's budget.
        horizon: number of steps of a full episode.
        trajectories: noise trajectories z to start from, shape (n, horizon, channels); n may be 0.
        predecessors: learners of earlier campaigns that the settings name.
        experience: experience of earlier campaigns that the settings name; None if they name none.
        parallel: number of episodes to run at a time; None if the campaign does not set it.
        seeds: seed of the episode that each trajectory comes from, if its replay is to have the
            same seed.
    """

    seed: int
    episodes: int
    horizon: int
    trajectories: Floats
    predecessors: tuple[Predecessor, ...] = ()
    experience: Experience | None = None
    parallel: int | None = None
    seeds: tuple[int | None, ...] = ()

    @property
    def channels(self) -> int:
        """Number of channels of the noise, which are the components of z at each step."""
        return int(self.trajectories.shape[2])

    def make_replays(self) -> list[TrajectorySource]:
        """Return a source for each trajectory, with its seed if the context has one."""
        seeds = self.seeds or (None,) * len(self.trajectories)
        return [TrajectorySource(z, seed=s) for z, s in zip(self.trajectories, seeds, strict=True)]

    def predecessor(self, campaign: int) -> Predecessor | None:
        """Return the learner of that campaign; None if it is not among the predecessors."""
        return next((one for one in self.predecessors if one.campaign == campaign), None)


class Proposal(msgspec.Struct, frozen=True, eq=False):
    """A round that a learner proposes.

    Attributes:
        sources: a source for each episode, in index order.
        policy: the policy version that its policy sources name, if it is new.
    """

    sources: tuple[Source, ...]
    policy: Policy | None = None


class RoundSizes(msgspec.Struct, frozen=True):
    """Sizes of a method's rounds, as far as they follow from its settings and the budget.

    Attributes:
        first: number of episodes of the first round.
        later: number of episodes of the largest later round.
        setting: name of the setting that makes rounds smaller.
        width: number of episodes that can be open at a time for most of a campaign, for any number
            of open rounds. For chains, which wait for their own moves, it is the number of chains.
            None if nothing limits it.
    """

    first: int
    later: int
    setting: str = "round_size"
    width: int | None = None


class Round(msgspec.Struct, frozen=True, eq=False):
    """Episodes that a learner proposed from one state, and observes together in index order."""

    number: int
    tasks: tuple[EpisodeTask, ...]
    policy: Policy | None = None
