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
"""What the adversary sees at each step, in the order of its components.

Its own last noise is among them since a tracker remembers it, and the tracker is not seen: without
it, the same action in the same state sometimes fools the planner and sometimes does not.
"""


SCENE_STATE = STATE.index("noise_x")
"""Components of `STATE` before those of the noise."""


def count_state(channels: int) -> int:
    """Return the number of components of the adversary's state with that many channels of noise.

    They are those of `STATE`, with a component for the last z of each channel in the place of
    `noise_x` and `noise_y`.
    """
    return SCENE_STATE + channels + 1


class Layer(msgspec.Struct, frozen=True, eq=False):
    """An affine map: weight of shape (out, in), bias of shape (out,)."""

    weight: Floats
    bias: Floats


class Policy(msgspec.Struct, frozen=True, eq=False):
    """A squashed Gaussian: z = amplitude · tanh(mean(h) + exp(log_std(h)) · eps), h = ReLU layers.

    Attributes:
        version: counts up within a campaign.
        hidden: layers with a ReLU behind each.
        mean: output layer for the mean of the action before the squashing.
        log_std: output layer for its log standard deviation, clamped to [-20, 2].
        amplitude: the largest |z| that the policy can ask for. [sigma]
        hold: number of steps for which one action stays.
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
        campaign: its id.
        method: its method, by name.
        settings: the method's settings, as given.
        seed: seed of its learner's random draws.
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
    """The experience from episodes of earlier campaigns: noise and robustness.

    Attributes:
        z: noise trajectories, zero behind an episode's end, shape (n, horizon, channels). [sigma]
        steps: number of steps of each episode, shape (n,).
        robustness_m: robustness of each episode, shape (n,).
    """

    z: Floats
    steps: Floats
    robustness_m: Floats


IN_FLIGHT = 1.5
"""Episodes that are proposed and not yet observed, for each that is to run at a time: those that
are on their way, and those whose round waits for its slowest episode. With more, `ast` runs
more episodes of old policies: with 1.75 it found 0.878 times the failures that it finds in two
rounds of ten, of its first 1000 episodes on `cut_in` with 100 at a time."""

MOST_OPEN_ROUNDS = 64

MOST_POLICIES = 2 * MOST_OPEN_ROUNDS
"""Policy versions that a worker keeps for a campaign: twice as many as can be open, so that an old
version, which an episode needs when it runs again, does not push out one that is in use."""


def count_rounds_ahead(parallel: int | None, round_size: int, least: int) -> int:
    """Return how many rounds to keep open besides the oldest one.

    Args:
        parallel: episodes that are to run at a time; None if the campaign does not say.
        round_size: episodes in a round.
        least: what the method takes by itself.
    """
    wanted = ceil(IN_FLIGHT * parallel / round_size) - 1 if parallel else 0
    return max(least, wanted)


CHAINS_IN_FLIGHT = 3.0
"""The same of methods that move chains: results that come late cost them nothing. Simulated with
`subset`, 20,000 episodes, P = 1e-4 and 100 workers, 0.98 of these were busy with 1.5 and with 3
where every episode takes 1 s; where they vary by 20 % (log-normal), 0.88 with 1.5, 0.96 with 3."""

OPEN_GROUPS = 12
"""Groups of chains, each a round, that are open at a time. With half as many, in groups twice as
large, more chains wait for the last one of their group; each round costs the service milliseconds,
which is why there are not more."""

FEWEST_TOGETHER = 5
"""Chains of a group, for however few workers."""


def choose_group_size(parallel: int) -> int:
    """Return the largest number of chains that move together, for `parallel` open episodes."""
    return max(ceil(CHAINS_IN_FLIGHT * parallel / OPEN_GROUPS), FEWEST_TOGETHER)


class LearnerContext(msgspec.Struct, frozen=True, eq=False):
    """The context that a learner is created with.

    Attributes:
        seed: seed of its own random draws.
        episodes: the campaign's budget.
        horizon: the number of steps of a full episode.
        trajectories: noise trajectories z to start from, shape (n, horizon, channels); n may be 0.
        predecessors: learners of earlier campaigns that the settings name.
        experience: experience of earlier campaigns that the settings name; None if they name none.
        parallel: episodes that the campaign wants to run at a time; None if it does not say.
        seeds: seed of the episode that each trajectory comes from, where a replay is to have it.
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
        """The number of channels of the noise: components of z at each step."""
        return int(self.trajectories.shape[2])

    def make_replays(self) -> list[TrajectorySource]:
        """Return a source for each trajectory, with its seed if the context has one."""
        seeds = self.seeds or (None,) * len(self.trajectories)
        return [TrajectorySource(z, seed=s) for z, s in zip(self.trajectories, seeds, strict=True)]

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
        width: episodes that can be open at a time for most of a campaign, however many rounds are:
            for chains, which wait for their own moves, their number; None if nothing limits it.
    """

    first: int
    later: int
    setting: str = "round_size"
    width: int | None = None


class Round(msgspec.Struct, frozen=True, eq=False):
    """The episodes that a learner proposed from one state; observed together, in index order."""

    number: int
    tasks: tuple[EpisodeTask, ...]
    policy: Policy | None = None
