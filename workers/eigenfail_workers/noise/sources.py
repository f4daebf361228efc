"""Where standardised noise z comes from: one small class for each kind of source."""

from collections.abc import Callable, Mapping
from typing import NamedTuple, Protocol

import numpy as np

from eigenfail.errors import InvalidValue
from eigenfail.values import (
    Floats,
    Observation,
    Policy,
    PolicySource,
    PriorSource,
    Source,
    TrajectorySource,
    VehicleState,
)
from eigenfail_workers.noise.policy import PolicyNoise

Pair = tuple[float, float]

NOISE_STREAM = 1
"""Sets the draws of the noise apart from what a scenario draws from the same seed."""


class NoiseSource(Protocol):
    """Gives the noise of one episode, step by step."""

    def draw(self, observation: Observation, actor: VehicleState, /) -> Pair:
        """z of the next step, longitudinal and lateral; both are values of float32. [sigma]"""

    def states(self) -> Floats | None:
        """What an adversary saw at each step, if there is one."""


class Circumstances(NamedTuple):
    """What a source may need to know to begin an episode."""

    seed: int
    horizon: int
    policies: Mapping[int, Policy]


class TrajectoryNoise:
    """Gives z as it stands, and zero after its end."""

    def __init__(self, z: Floats) -> None:
        self._rows = iter(z.tolist())

    def draw(self, _observation: Observation, _actor: VehicleState, /) -> Pair:
        """The next row."""
        longitudinal, lateral = next(self._rows, (0.0, 0.0))
        return longitudinal, lateral

    def states(self) -> None:
        """None: nobody looked."""
        return


def generator(seed: int) -> np.random.Generator:
    """The generator of an episode's noise."""
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(NOISE_STREAM,)))


def from_prior(_source: PriorSource, given: Circumstances) -> NoiseSource:
    """All of z at once, from the standard normal."""
    draws = generator(given.seed).standard_normal((given.horizon, 2), dtype=np.float32)
    return TrajectoryNoise(draws)


def from_trajectory(source: TrajectorySource, _given: Circumstances) -> NoiseSource:
    """The trajectory that the source carries."""
    z = source.z
    if z.ndim != 2 or z.shape[1] != 2 or not np.isfinite(z).all():
        raise InvalidValue(
            "source.z",
            f"a trajectory of shape {z.shape} is not (steps, 2) finite numbers.",
            "Give longitudinal and lateral noise for each step.",
        )
    return TrajectoryNoise(z.astype(np.float32))


def from_policy(source: PolicySource, given: Circumstances) -> NoiseSource:
    """The policy of the version that the source names."""
    policy = given.policies.get(source.version)
    if policy is None:
        known = ", ".join(map(str, given.policies)) or "none"
        raise InvalidValue(
            "source.version",
            f"policy version {source.version} is not known here; known: {known}.",
            "Send the policy before the episodes that need it.",
        )
    return PolicyNoise(policy, generator(given.seed), given.horizon)


KINDS: dict[type, Callable[..., NoiseSource]] = {
    PriorSource: from_prior,
    TrajectorySource: from_trajectory,
    PolicySource: from_policy,
}


def begin(source: Source, given: Circumstances) -> NoiseSource:
    """The noise of one episode.

    Raises:
        InvalidValue: the source cannot give any.
    """
    return KINDS[type(source)](source, given)
