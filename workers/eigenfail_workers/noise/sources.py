"""Sources of standardised noise z: one small class for each kind of source."""

from collections.abc import Callable, Mapping
from typing import NamedTuple, Protocol

import numpy as np

from eigenfail.errors import InvalidValue
from eigenfail.values.arrays import Floats
from eigenfail.values.disturbance import AXES
from eigenfail.values.episode import PolicySource, PriorSource, Source, TrajectorySource
from eigenfail.values.learning import Policy
from eigenfail.values.scene import Observation, VehicleState
from eigenfail.values.shapes import Row
from eigenfail_workers.noise.policy import PolicyNoise

NOISE_STREAM = 1
"""Separates the draws of the noise from those of a scenario with the same seed."""

ONCE_STREAM = 3
"""Stream of the channels that are drawn once an episode, which no policy chooses. Stream 2 draws
the scenario parameters that vary."""


class NoiseSource(Protocol):
    """Noise of one episode, step by step."""

    def draw(self, observation: Observation, actor: VehicleState, /) -> Row:
        """Return z of the next step, one of each channel, as values of float32. [sigma]"""

    def first(self) -> Row:
        """Return z of the first step, before it is drawn; 0 if an adversary has yet to choose.

        It already contains the values of channels that are drawn once, also under an adversary.
        """

    def states(self) -> Floats | None:
        """Return the states that an adversary has observed; None without an adversary."""


class NoiseContext(NamedTuple):
    """Facts of an episode that a source may need to begin it.

    Attributes:
        once: columns of the channels that are drawn once an episode.
    """

    seed: int
    horizon: int
    policies: Mapping[int, Policy]
    channels: int = len(AXES)
    once: tuple[int, ...] = ()


class TrajectoryNoise:
    """Noise of a given trajectory, and zero after its end."""

    def __init__(self, z: Floats) -> None:
        self._rows = iter(z.tolist())
        self._zero: Row = (0.0,) * z.shape[1]
        self._first: Row = tuple(z[0].tolist()) if len(z) else self._zero

    def draw(self, _observation: Observation, _actor: VehicleState, /) -> Row:
        """Return the next row."""
        return tuple(next(self._rows, self._zero))

    def first(self) -> Row:
        """Return the first row."""
        return self._first

    def states(self) -> None:
        """Return None: only an adversary has states."""
        return


def generator(seed: int, stream: int = NOISE_STREAM) -> np.random.Generator:
    """Return the random generator of an episode's noise."""
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(stream,)))


def from_prior(_source: PriorSource, context: NoiseContext) -> NoiseSource:
    """Return noise that is drawn at once from the standard normal distribution."""
    shape = context.horizon, context.channels
    # Drawn row by row, a step each: a longer horizon leaves the first rows as they are, which
    # `CampaignNoise.choose` relies on.
    return TrajectoryNoise(generator(context.seed).standard_normal(shape, dtype=np.float32))


def from_trajectory(source: TrajectorySource, context: NoiseContext) -> NoiseSource:
    """Return the noise of the trajectory in the source."""
    z = source.z
    if z.ndim != 2 or z.shape[1] != context.channels or not np.isfinite(z).all():
        raise InvalidValue(
            "source.z",
            f"a trajectory of shape {z.shape} is not (steps, {context.channels}) finite numbers.",
            "Give the noise of each channel for each step.",
        )
    return TrajectoryNoise(z.astype(np.float32))


def from_policy(source: PolicySource, context: NoiseContext) -> NoiseSource:
    """Return the noise of the policy version that the source names."""
    policy = context.policies.get(source.version)
    if policy is None:
        known = ", ".join(map(str, context.policies)) or "none"
        raise InvalidValue(
            "source.version",
            f"policy version {source.version} is not known here; known: {known}.",
            "Send the policy before the episodes that need it.",
        )
    fixed: dict[int, float] = {}
    if context.once:
        # A stream of their own: otherwise the number of these channels would change the policy's
        # noise.
        drawn = generator(context.seed, ONCE_STREAM).standard_normal(
            len(context.once), dtype=np.float32
        )
        fixed = dict(zip(context.once, drawn.tolist(), strict=True))
    return PolicyNoise(policy, generator(context.seed), context.horizon, context.channels, fixed)


KINDS: dict[type, Callable[..., NoiseSource]] = {
    PriorSource: from_prior,
    TrajectorySource: from_trajectory,
    PolicySource: from_policy,
}


def begin(source: Source, context: NoiseContext) -> NoiseSource:
    """Return the noise of one episode.

    Raises:
        InvalidValue: the source cannot provide noise.
    """
    return KINDS[type(source)](source, context)
