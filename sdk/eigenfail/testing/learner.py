"""Conformance suite of learners, to be run for every method.

Subclass `LearnerSuite` in a test module under a name that begins with `Test`, and set `method`,
`settings` and `budget`; pytest does the rest.
"""

from collections.abc import Iterator, Mapping, Sequence
from types import MappingProxyType
from typing import Any, ClassVar

import msgspec
import numpy as np
from numpy.typing import NDArray

from eigenfail.contracts import EpisodeEngine, Learner, Method
from eigenfail.errors import ProtocolError
from eigenfail.settings import read_settings
from eigenfail.testing import expect, expect_error
from eigenfail.values import (
    STATE,
    EpisodeFault,
    EpisodeResult,
    EpisodeTask,
    Floats,
    Layer,
    LearnerContext,
    Measures,
    NoiseTrajectory,
    Outcome,
    Policy,
    PolicySource,
    PriorSource,
    Proposal,
    TrajectorySource,
    episode_seed,
    learner_seed,
    unrunnable,
)
from eigenfail.values.arrays import encode_array

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

    def add_policy(self, policy: Policy) -> None:
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
            importance=course[:steps].astype(np.float32) if task.importance else None,
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


GARBAGE = (b"", b"\xc1", b"no state", msgspec.msgpack.encode({"kind": "another"}))


CORRIDOR = Corridor(wall=0.5)


def encode_proposal(proposal: Proposal) -> bytes:
    """Return the bytes of a proposal, with weights and trajectories."""
    return msgspec.msgpack.encode(proposal, enc_hook=encode_array)


class LearnerSuite:
    """Checks that every learner must pass."""

    method: ClassVar[Method]
    settings: ClassVar[Mapping[str, Any]] = MappingProxyType({})
    budget: ClassVar[int] = 40
    rounds: ClassVar[int] = 3

    def learner(self, seed: int = 0) -> Learner:
        """Return a new learner for a corridor with frequent failures."""
        random = np.random.default_rng(seed)
        context = LearnerContext(
            seed=learner_seed(seed),
            episodes=self.budget,
            horizon=CORRIDOR.steps,
            trajectories=random.standard_normal((self.budget, CORRIDOR.steps, 2), np.float32),
        )
        return self.method(context, read_settings(self.method.Settings, self.settings, "settings"))

    def play(self, learner: Learner, first: int, engine: EpisodeEngine | None = None) -> Proposal:
        """Propose, run and observe one round from episode `first` on."""
        engine = engine or ToyEngine(CORRIDOR)
        proposal = learner.propose(self.budget - first)
        learner.observe(results(proposal, first, engine))
        return proposal

    def begun(self, seed: int = 0) -> tuple[Learner, int]:
        """Return a learner after some rounds, and the number of its next episode."""
        learner, first = self.learner(seed), 0
        for _ in range(self.rounds):
            first += len(self.play(learner, first).sources)
        expect(first < self.budget, "set a budget that outlasts `rounds` rounds")
        return learner, first

    def test_looks_ahead_by_a_whole_number_of_rounds(self) -> None:
        """`lookahead` is 0 or more."""
        expect(self.learner().lookahead >= 0, "lookahead is negative")

    def test_proposes_from_one_to_n_episodes(self) -> None:
        """A proposal has at most n episodes, for any n."""
        for n in (1, 2, 7, self.budget):
            count = len(self.learner().propose(n).sources)
            expect(1 <= count <= n, f"{count} episodes proposed where 1 to {n} were asked for")

    def test_uses_its_budget_and_no_more(self) -> None:
        """A campaign ends with the budget or with an empty proposal."""
        learner, first = self.learner(), 0
        while first < self.budget:
            count = len(self.play(learner, first).sources)
            expect(first + count <= self.budget, "proposed beyond the budget")
            if count == 0:
                break
            first += count
        expect(first > 0, "proposed nothing at all")

    def test_trajectories_fit_the_horizon_and_are_finite(self) -> None:
        """Injected noise is float32 of shape (up to horizon, 2)."""
        learner, first = self.begun()
        for source in learner.propose(self.budget - first).sources:
            if isinstance(source, TrajectorySource):
                steps, axes = source.z.shape
                expect(steps <= CORRIDOR.steps and axes == 2, f"shape {source.z.shape}")
                expect(source.z.dtype == np.float32, f"dtype {source.z.dtype}")
                expect(bool(np.isfinite(source.z).all()), "a value is not finite")

    def test_same_seed_and_results_give_the_same_proposals(self) -> None:
        """Equal seeds give equal proposals, bit for bit, over several rounds."""
        expect(self.course(self.learner()) == self.course(self.learner()), "proposals differ")

    def test_leaves_the_global_generators_alone(self) -> None:
        """A learner does not change the global random state of its process."""
        before = global_numbers()
        self.begun()
        expect(np.array_equal(before, global_numbers()), "numpy's global generator was used")

    def test_restored_learner_goes_on_bit_for_bit(self) -> None:
        """A state is complete: a learner that restores it forgets its own."""
        learner, first = self.begun()
        state = learner.state()
        expected = self.course(learner, first)
        for other in (self.learner(), self.begun()[0]):
            other.restore(state)
            expect(other.state() == state, "the state of a restored learner is another one")
            expect(self.course(other, first) == expected, "proposals differ after a restore")

    def test_refuses_garbage_as_a_state_and_stays_as_it_was(self) -> None:
        """Damaged states are refused by a ProtocolError."""
        learner, _ = self.begun()
        state = learner.state()
        damaged = bytearray(state)
        damaged[len(state) // 2] ^= 0xFF
        for garbage in (*GARBAGE, state[:-1], bytes(damaged)):
            with expect_error(ProtocolError, f"{garbage[:20]!r}… was accepted as a state."):
                learner.restore(garbage)
            expect(learner.state() == state, "a refused state has changed the learner")

    def test_tolerates_failed_episodes(self) -> None:
        """A campaign goes on after some errored episodes, and after a round of them."""
        learner, first = self.learner(), 0
        for faulty in (range(0, self.budget, 3), range(self.budget), ()):
            first += len(self.play(learner, first, ToyEngine(CORRIDOR, tuple(faulty))).sources)
        expect(first < self.budget, "set a budget that outlasts three rounds")
        expect(len(learner.propose(self.budget - first).sources) > 0, "gave up")

    def course(self, learner: Learner, first: int = 0) -> list[bytes]:
        """Return the proposals of the next rounds."""
        said = []
        for _ in range(self.rounds):
            if first >= self.budget:
                break
            proposal = self.play(learner, first)
            first += len(proposal.sources)
            said.append(encode_proposal(proposal))
        return said


def results(proposal: Proposal, first: int, engine: EpisodeEngine) -> Sequence[EpisodeResult]:
    """Run a proposal whose first episode has the index `first`."""
    if proposal.policy is not None:
        engine.add_policy(proposal.policy)
    tasks = [
        EpisodeTask(index, episode_seed(0, index), source)
        for index, source in enumerate(proposal.sources, first)
    ]
    return list(engine.run(tasks))


def global_numbers() -> NDArray[np.uint32]:
    """Return the state of numpy's global generator."""
    state = np.random.get_state(legacy=False)  # noqa: NPY002 - this generator is the subject
    return np.array(state["state"]["key"], np.uint32)
