"""A small world in numpy that runs any method, in less than a millisecond an episode."""

from collections.abc import Iterator, Sequence

import msgspec
import numpy as np
from numpy.typing import NDArray

from eigenfail.values import (
    STATE,
    EpisodeFault,
    EpisodeResult,
    EpisodeTask,
    Floats,
    Layer,
    Measures,
    NoiseTrajectory,
    Outcome,
    Policy,
    PolicySource,
    PriorSource,
    TrajectorySource,
    unrunnable,
)

LAST_NOISE = slice(STATE.index("noise_x"), STATE.index("noise_y") + 1)


class Corridor(msgspec.Struct, frozen=True):
    """A vehicle that follows low-pass filtered longitudinal noise, and a wall.

    y_t = (1 - gain) · y_{t-1} + gain · z_t fails once it reaches `wall`; robustness is the
    distance to it. White noise is filtered away; noise that lasts is not.
    """

    steps: int = 40
    gain: float = 0.1
    wall: float = 1.0
    sigma: tuple[float, float] = (2.0, 0.4)

    def course(self, z: NDArray[np.floating]) -> NDArray[np.float64]:
        """Return y after each step, shape (…, steps), for noise of shape (…, steps, 2)."""
        y = np.zeros(z.shape[:-1])
        last = np.zeros(z.shape[:-2])
        for t in range(z.shape[-2]):
            last = y[..., t] = (1.0 - self.gain) * last + self.gain * z[..., t, 0]
        return y


class ToyEngine:
    """Runs episodes in a corridor, for every kind of source.

    Args:
        corridor: the world.
        faulty: indices of episodes that fail to run.
    """

    def __init__(self, corridor: Corridor | None = None, faulty: Sequence[int] = ()) -> None:
        self._corridor = corridor or Corridor()
        self._faulty = frozenset(faulty)
        self._policies: dict[int, Policy] = {}

    def learn(self, policy: Policy) -> None:
        """Store a policy version."""
        self._policies[policy.version] = policy

    def run(self, tasks: Sequence[EpisodeTask]) -> Iterator[EpisodeResult]:
        """Yield the results in the order of the tasks."""
        for task in tasks:
            if task.index in self._faulty:
                yield unrunnable(task, EpisodeFault("simulator", "the toy was told to fail"))
            else:
                yield self._episode(task)

    def close(self) -> None:
        """Do nothing: the engine holds no resources."""

    def _episode(self, task: EpisodeTask) -> EpisodeResult:
        random = np.random.default_rng(task.seed)
        states = np.zeros((self._corridor.steps, len(STATE)), np.float32)
        z = self._noise(task, random, states)
        course = self._corridor.course(z)
        beyond = np.flatnonzero(course >= self._corridor.wall)
        steps = int(beyond[0]) + 1 if len(beyond) else self._corridor.steps
        sigma = np.broadcast_to(np.asarray(self._corridor.sigma, np.float32), (steps, 2))
        return EpisodeResult(
            index=task.index,
            seed=task.seed,
            outcome=Outcome.COLLISION if len(beyond) else Outcome.SAFE,
            steps=steps,
            noise=NoiseTrajectory(z[:steps].astype(np.float32), np.ascontiguousarray(sigma)),
            source=task.source_kind,
            measures=self._measures(course, len(beyond) > 0),
            states=states[:steps] if isinstance(task.source, PolicySource) else None,
        )

    def _noise(self, task: EpisodeTask, random: np.random.Generator, states: Floats) -> Floats:
        source = task.source
        if isinstance(source, PriorSource):
            return random.standard_normal((len(states), 2), np.float32)
        if isinstance(source, TrajectorySource):
            z = np.zeros((len(states), 2), np.float32)
            z[: len(source.z)] = source.z[: len(z)]
            return z
        return self._chosen(self._policies[source.version], random, states)

    def _chosen(self, policy: Policy, random: np.random.Generator, states: Floats) -> Floats:
        """Return z of a policy's episode, and write its observed states into `states`."""
        z = np.zeros((len(states), 2), np.float32)
        y = 0.0
        for t in range(len(states)):
            states[t, 0], states[t, -1] = y, t / len(states)
            states[t, LAST_NOISE] = z[t - 1] / 3.0 if t else 0.0
            held = t % policy.hold
            z[t] = z[t - held] if held else decide(policy, states[t], random.standard_normal(2))
            y = (1.0 - self._corridor.gain) * y + self._corridor.gain * float(z[t, 0])
        return z

    def _measures(self, course: NDArray[np.float64], failed: bool) -> Measures:
        if failed:
            return Measures(robustness_m=0.0, severity=1.0)
        return Measures(robustness_m=float(self._corridor.wall - course.max()))


def decide(policy: Policy, state: Floats, eps: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return z of one decision, shape (2,), as `Policy` defines it.

    Args:
        policy: which decides.
        state: shape (len(STATE),).
        eps: standard normal numbers, shape (2,).
    """
    h: NDArray[np.floating] = state
    for layer in policy.hidden:
        h = np.maximum(_affine(layer, h), 0.0)
    std = np.exp(np.clip(_affine(policy.log_std, h), -20.0, 2.0))
    z: NDArray[np.float64] = policy.amplitude * np.tanh(_affine(policy.mean, h) + std * eps)
    return z


def _affine(layer: Layer, h: NDArray[np.floating]) -> NDArray[np.floating]:
    return layer.weight @ h + layer.bias
