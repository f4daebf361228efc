"""The adversary's policy in numpy: a squashed Gaussian of the observed state.

An episode must not depend on the worker that runs it, nor on its neighbours there. The last bits of
a BLAS product depend on the type of the processor and the size of the batch. The last bits of
numpy's exp and tanh in float32 depend on the type of the processor. So a layer is a sum of products
for one state, and exp and tanh come from the C library, in float64.
"""

from collections.abc import Mapping, MutableMapping
from math import exp, isfinite, tanh
from types import MappingProxyType

import msgspec
import numpy as np

from eigenfail.errors import InvalidValue
from eigenfail.values.arrays import Floats
from eigenfail.values.disturbance import AXES
from eigenfail.values.learning import MOST_POLICIES, STATE, Layer, Policy, count_state
from eigenfail.values.scene import Observation, VehicleState
from eigenfail.values.shapes import Row

# The bounds of SAC's log standard deviation in Stable-Baselines3, which trains policies: with
# others, a trained policy would act differently here than in its training.
LOG_STD_MIN, LOG_STD_MAX = np.float32(-20.0), np.float32(2.0)


def state_vector(observation: Observation, actor: VehicleState, last: Row, horizon: int) -> Floats:
    """Return what the adversary observes, in order and units of STATE.

    Args:
        observation: the truth at this step.
        actor: the vehicle whose position is disturbed.
        last: z of the step before. [sigma]
        horizon: the number of steps of a full episode.

    Returns:
        Shape (count_state(channels),), with a component for each value of `last`.
    """
    ego = observation.ego
    return np.array(
        (
            (actor.x_m - ego.x_m) / 100.0,
            (actor.y_m - ego.y_m) / 4.0,
            ego.speed_mps / 30.0,
            actor.speed_mps / 30.0,
            actor.heading_rad,
            *[each / 3.0 for each in last],
            observation.step / horizon,
        ),
        np.float32,
    )


def act(policy: Policy, state: Floats, eps: Floats) -> Floats:
    """z = amplitude · tanh(mean + exp(log_std) · eps) of each channel, as float32. [sigma]"""
    hidden = state
    for layer in policy.hidden:
        hidden = np.maximum(_affine(layer, hidden), np.float32(0.0))
    log_std = np.clip(_affine(policy.log_std, hidden), LOG_STD_MIN, LOG_STD_MAX)
    axes = zip(_affine(policy.mean, hidden).tolist(), log_std.tolist(), eps.tolist(), strict=True)
    squashed = np.array([tanh(mean + exp(width) * drawn) for mean, width, drawn in axes])
    z: Floats = np.float32(policy.amplitude) * squashed.astype(np.float32)
    return z


def _affine(layer: Layer, x: Floats) -> Floats:
    sums: Floats = (layer.weight * x).sum(axis=1)
    return sums + layer.bias


def copy_policy(policy: Policy) -> Policy:
    """Return a copy in one memory layout, as the last bits of a sum depend on the layout."""
    return msgspec.structs.replace(
        policy,
        # A policy from a message and one from a trainer may differ in layout, and be equal.
        hidden=tuple(map(_copy_layer, policy.hidden)),
        mean=_copy_layer(policy.mean),
        log_std=_copy_layer(policy.log_std),
    )


def _copy_layer(layer: Layer) -> Layer:
    return Layer(*(np.array(part, np.float32, order="C") for part in (layer.weight, layer.bias)))


def validate_policy(policy: Policy, channels: int = len(AXES)) -> None:
    """Check that a policy can act on noise with that many channels.

    Raises:
        InvalidValue: its layers do not fit each other, hold NaN or infinity, or the number of
            steps for which it holds an action is not positive.
    """
    width = count_state(channels)
    for layer in policy.hidden:
        _check_layer(layer, (layer.bias.size, width))
        width = layer.bias.size
    _check_layer(policy.mean, (channels, width))
    _check_layer(policy.log_std, (channels, width))
    if policy.hold < 1 or not 0.0 < policy.amplitude < np.inf:
        raise InvalidValue("policy", "hold must be at least 1 and the amplitude positive.")


def _check_layer(layer: Layer, shape: tuple[int, int]) -> None:
    fits = layer.weight.shape == shape and layer.bias.shape == shape[:1]
    if not fits or not (np.isfinite(layer.weight).all() and np.isfinite(layer.bias).all()):
        raise InvalidValue(
            "policy",
            f"a layer of weight {layer.weight.shape} and bias {layer.bias.shape} is not of shape "
            f"{shape} with finite numbers.",
            f"The input is the state ({', '.join(STATE)}), with a last noise of each channel, the "
            "output z of each channel.",
        )


def _to_row(z: Floats) -> Row:
    row: Row = tuple(z.tolist())
    if not isfinite(sum(row)):
        raise InvalidValue("policy", f"it asks for z = {row}.")
    return row


class PolicyNoise:
    """Noise that a policy chooses; each choice is held for `policy.hold` steps.

    Columns that are fixed keep their value, whatever the policy chooses.
    """

    def __init__(
        self,
        policy: Policy,
        generator: np.random.Generator,
        horizon: int,
        channels: int = len(AXES),
        fixed: Mapping[int, float] = MappingProxyType({}),
    ) -> None:
        validate_policy(policy, channels)
        self._fixed = fixed
        self._policy = policy
        self._generator = generator
        self._horizon = horizon
        self._held: Row = self._fix((0.0,) * channels)
        self._states: list[Floats] = []

    def draw(self, observation: Observation, actor: VehicleState, /) -> Row:
        """Return z of this step. [sigma]

        Raises:
            InvalidValue: the policy requests a number beyond the range of float32.
        """
        state = state_vector(observation, actor, self._held, self._horizon)
        if len(self._states) % self._policy.hold == 0:
            eps = self._generator.standard_normal(len(self._held), dtype=np.float32)
            self._held = self._fix(_to_row(act(self._policy, state, eps)))
        self._states.append(state)
        return self._held

    def first(self) -> Row:
        """Return the values that are fixed, and 0 for those that the policy has yet to choose."""
        return self._fix((0.0,) * len(self._held))

    def _fix(self, row: Row) -> Row:
        if not self._fixed:
            return row
        return tuple([self._fixed.get(column, value) for column, value in enumerate(row)])

    def states(self) -> Floats:
        """Return the observed state of each step, shape (steps, count_state(channels))."""
        return np.array(self._states, np.float32).reshape(-1, count_state(len(self._held)))


def store_policy(policies: MutableMapping[int, Policy], policy: Policy) -> None:
    """Add a copy of a policy version, and drop the lowest versions."""
    policies[policy.version] = copy_policy(policy)
    while len(policies) > MOST_POLICIES:
        del policies[min(policies)]
