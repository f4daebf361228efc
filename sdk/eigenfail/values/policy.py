"""A stochastic policy of an adversary, as raw weights that travel and run in numpy."""

import msgspec

from eigenfail.values.arrays import Floats

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
