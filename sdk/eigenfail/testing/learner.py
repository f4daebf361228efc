"""Conformance suite of learners, to be run for every method.

Subclass `LearnerSuite` in a test module under a name that begins with `Test`, and set `method`,
`settings` and `budget`; pytest does the rest.
"""

import random
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
from eigenfail.values import episode, learning
from eigenfail.values.arrays import Floats, encode_array
from eigenfail.values.disturbance import NoiseTrajectory
from eigenfail.values.measures import Measures


class Corridor(msgspec.Struct, frozen=True):
    """A vehicle and a wall; its position is the low-pass filtered noise of the first channel.

    The position y_t = (1 - gain) · y_{t-1} + gain · z_t fails once it reaches `wall`; robustness is
    the distance to the wall. The filter removes white noise, but not lasting noise.
    """

    steps: int = 40
    gain: float = 0.1
    wall: float = 1.0
    sigma: tuple[float, ...] = (2.0, 0.4)

    @property
    def channels(self) -> int:
        """Number of channels of the noise, one for each sigma."""
        return len(self.sigma)

    def course(self, z: NDArray[np.floating]) -> NDArray[np.float64]:
        """Return y after each step, shape (…, steps), for noise of shape (…, steps, channels)."""
        y = np.zeros(z.shape[:-1])
        last = np.zeros(z.shape[:-2])
        for t in range(z.shape[-2]):
            last = y[..., t] = (1.0 - self.gain) * last + self.gain * z[..., t, 0]
        return y


class ToyEngine:
    """An engine that runs episodes in a corridor, for every kind of source.

    Args:
        corridor: the world.
        faulty: indices of episodes that fail to run.
    """

    def __init__(self, corridor: Corridor | None = None, faulty: Sequence[int] = ()) -> None:
        self._corridor = corridor or Corridor()
        self._faulty = frozenset(faulty)
        self._policies: dict[int, learning.Policy] = {}

    def add_policy(self, policy: learning.Policy) -> None:
        """Store a policy version."""
        self._policies[policy.version] = policy

    def run(self, tasks: Sequence[episode.EpisodeTask]) -> Iterator[episode.EpisodeResult]:
        """Yield the results in the order of the tasks."""
        for task in tasks:
            if task.index in self._faulty:
                yield episode.unrunnable(
                    task, episode.EpisodeFault("simulator", "the toy was told to fail")
                )
            else:
                yield self._episode(task)

    def close(self) -> None:
        """Do nothing: the engine holds no resources."""

    def _episode(self, task: episode.EpisodeTask) -> episode.EpisodeResult:
        random = np.random.default_rng(task.seed)
        channels = self._corridor.channels
        states = np.zeros((self._corridor.steps, learning.count_state(channels)), np.float32)
        z = self._noise(task, random, states)
        course = self._corridor.course(z)
        beyond = np.flatnonzero(course >= self._corridor.wall)
        steps = int(beyond[0]) + 1 if len(beyond) else self._corridor.steps
        sigma = np.broadcast_to(np.asarray(self._corridor.sigma, np.float32), (steps, channels))
        return episode.EpisodeResult(
            index=task.index,
            seed=task.seed,
            outcome=episode.Outcome.COLLISION if len(beyond) else episode.Outcome.SAFE,
            steps=steps,
            noise=NoiseTrajectory(z[:steps].astype(np.float32), np.ascontiguousarray(sigma)),
            source=task.source_kind,
            measures=self._measures(course, len(beyond) > 0),
            states=states[:steps] if isinstance(task.source, episode.PolicySource) else None,
            importance=course[:steps].astype(np.float32) if task.importance else None,
        )

    def _noise(
        self, task: episode.EpisodeTask, random: np.random.Generator, states: Floats
    ) -> Floats:
        source, shape = task.source, (len(states), self._corridor.channels)
        if isinstance(source, episode.PriorSource):
            return random.standard_normal(shape, np.float32)
        if isinstance(source, episode.TrajectorySource):
            z = np.zeros(shape, np.float32)
            z[: len(source.z)] = source.z[: len(z)]
            return z
        return self._chosen(self._policies[source.version], random, states)

    def _chosen(
        self, policy: learning.Policy, random: np.random.Generator, states: Floats
    ) -> Floats:
        """Return z of a policy's episode, and write the observed states into `states`."""
        channels = self._corridor.channels
        z = np.zeros((len(states), channels), np.float32)
        y = 0.0
        for t in range(len(states)):
            states[t, 0], states[t, -1] = y, t / len(states)
            # In the scale of `STATE`: per 3 sigma.
            states[t, learning.SCENE_STATE : learning.SCENE_STATE + channels] = (
                z[t - 1] / 3.0 if t else 0.0
            )
            held = t % policy.hold
            if held:
                z[t] = z[t - held]
            else:
                z[t] = decide(policy, states[t], random.standard_normal(channels))
            y = (1.0 - self._corridor.gain) * y + self._corridor.gain * float(z[t, 0])
        return z

    def _measures(self, course: NDArray[np.float64], failed: bool) -> Measures:
        if failed:
            return Measures(robustness_m=0.0, severity=1.0)
        return Measures(robustness_m=float(self._corridor.wall - course.max()))


def decide(policy: learning.Policy, state: Floats, eps: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return z of one decision, shape (channels,), as `Policy` defines it.

    Args:
        policy: the deciding policy.
        state: observed state, shape (count_state(channels),).
        eps: standard normal numbers, shape (channels,).
    """
    h: NDArray[np.floating] = state
    for layer in policy.hidden:
        h = np.maximum(_affine(layer, h), 0.0)
    # The bounds that `Policy.log_std` states.
    std = np.exp(np.clip(_affine(policy.log_std, h), -20.0, 2.0))
    z: NDArray[np.float64] = policy.amplitude * np.tanh(_affine(policy.mean, h) + std * eps)
    return z


def _affine(layer: learning.Layer, h: NDArray[np.floating]) -> NDArray[np.floating]:
    return layer.weight @ h + layer.bias


# 0xC1 is the one byte with which no MessagePack begins.
GARBAGE = (b"", b"\xc1", b"no state", msgspec.msgpack.encode({"kind": "another"}))


def make_corridor(channels: int) -> Corridor:
    """Return a corridor with frequent failures and the given number of channels."""
    return Corridor(wall=0.5, sigma=(2.0, *(0.4,) * (channels - 1)))


CORRIDOR = make_corridor(2)

OTHER_CHANNELS = (1, 5)
"""Numbers of channels besides the two of a road: a single one has no other beside it, and with
five, no two dimensions of an array are equal by chance."""


def encode_proposal(proposal: learning.Proposal) -> bytes:
    """Return the bytes of a proposal, with weights and trajectories."""
    return msgspec.msgpack.encode(proposal, enc_hook=encode_array)


class LearnerSuite:
    """Checks that every learner must pass.

    Override `context` if the method needs other noise, or an earlier campaign.
    """

    method: ClassVar[Method]
    settings: ClassVar[Mapping[str, Any]] = MappingProxyType({})
    budget: ClassVar[int] = 40
    rounds: ClassVar[int] = 3
    most: ClassVar[int] = 1_000_000
    """Most episodes of a round, for a method that proposes as many as it may."""

    def context(self, seed: int, corridor: Corridor) -> learning.LearnerContext:
        """Return the context of a learner, for noise with the shape of a corridor's noise."""
        random = np.random.default_rng(seed)
        shape = self.budget, corridor.steps, corridor.channels
        return learning.LearnerContext(
            seed=episode.learner_seed(seed),
            episodes=self.budget,
            horizon=corridor.steps,
            trajectories=random.standard_normal(shape, np.float32),
        )

    def learner(self, seed: int = 0, corridor: Corridor = CORRIDOR) -> Learner:
        """Return a new learner for a corridor with frequent failures."""
        settings = read_settings(self.method.Settings, self.settings, "settings")
        return self.method(self.context(seed, corridor), settings)

    def play(
        self, learner: Learner, first: int, engine: EpisodeEngine | None = None
    ) -> learning.Proposal:
        """Propose, run and observe one round from episode `first` on."""
        engine = engine or ToyEngine(CORRIDOR)
        proposal = learner.propose(min(self.most, self.budget - first))
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
        """Injected noise is float32 of shape (up to horizon, channels)."""
        learner, first = self.begun()
        for source in learner.propose(self.budget - first).sources:
            if isinstance(source, episode.TrajectorySource):
                expect_fit(source.z, CORRIDOR)

    def test_takes_noise_of_any_number_of_channels(self) -> None:
        """Proposals and states fit the channels of the context."""
        for channels in OTHER_CHANNELS:
            corridor = make_corridor(channels)
            engine, learner, first = ToyEngine(corridor), self.learner(corridor=corridor), 0
            for _ in range(self.rounds):
                proposal = self.play(learner, first, engine)
                first += len(proposal.sources)
                for source in proposal.sources:
                    if isinstance(source, episode.TrajectorySource):
                        expect_fit(source.z, corridor)
            state = learner.state()
            other = self.learner(corridor=corridor)
            other.restore(state)
            expect(other.state() == state, f"the state is another one (channels: {channels})")
            expected = encode_proposal(self.play(learner, first, engine))
            found = encode_proposal(self.play(other, first, engine))
            expect(found == expected, f"proposals differ after a restore (channels: {channels})")

    def test_same_seed_and_results_give_the_same_proposals(self) -> None:
        """Equal seeds give equal proposals, bit for bit, over several rounds."""
        expect(self.course(self.learner()) == self.course(self.learner()), "proposals differ")

    def test_leaves_the_global_generators_alone(self) -> None:
        """A learner does not change the global random state of its process."""
        # One draw ahead: a method that seeds a generator anew does not come back to this state.
        np.random.random()  # noqa: NPY002 - this generator is the subject
        random.random()  # noqa: S311 - as above
        before = read_global_generators()
        self.begun()
        expect(before == read_global_generators(), "a global generator was used: draw from `seed`")

    def test_restored_learner_goes_on_bit_for_bit(self) -> None:
        """A state is complete: a learner that restores it forgets its own state."""
        learner, first = self.begun()
        state = learner.state()
        expected = self.course(learner, first)
        # Also one that has learned something else: what it keeps would show in its proposals.
        for other in (self.learner(), self.begun()[0]):
            other.restore(state)
            expect(other.state() == state, "the state of a restored learner is another one")
            expect(self.course(other, first) == expected, "proposals differ after a restore")

    def test_refuses_garbage_as_a_state_and_stays_as_it_was(self) -> None:
        """Damaged states are refused by a ProtocolError."""
        learner, _ = self.begun()
        state = learner.state()
        damaged = bytearray(state)
        # In the middle, where weights and noise are, and not in the header that any decoder
        # checks.
        damaged[len(state) // 2] ^= 0xFF
        for garbage in (*GARBAGE, state[:-1], bytes(damaged)):
            with expect_error(ProtocolError, f"{garbage[:20]!r}… was accepted as a state."):
                learner.restore(garbage)
            expect(learner.state() == state, "a refused state has changed the learner")

    def test_tolerates_failed_episodes(self) -> None:
        """A campaign continues after some errored episodes, and after a round of them."""
        learner, first = self.learner(), 0
        # Some, then all, then none: a learner may divide by the number of episodes that completed.
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


def expect_fit(z: Floats, corridor: Corridor) -> None:
    """Fail unless noise fits the episodes of a corridor."""
    steps, channels = z.shape
    fits = steps <= corridor.steps and channels == corridor.channels
    expect(fits, f"shape {z.shape}, not up to {corridor.steps} steps of {corridor.channels}")
    expect(z.dtype == np.float32, f"dtype {z.dtype}, not float32")
    expect(bool(np.isfinite(z).all()), "a value is not finite")


def results(
    proposal: learning.Proposal, first: int, engine: EpisodeEngine
) -> Sequence[episode.EpisodeResult]:
    """Run a proposal whose first episode has the index `first`."""
    if proposal.policy is not None:
        engine.add_policy(proposal.policy)
    tasks = [
        episode.EpisodeTask(index, episode.episode_seed(0, index), source)
        for index, source in enumerate(proposal.sources, first)
    ]
    return list(engine.run(tasks))


def read_global_generators() -> tuple[Any, ...]:
    """Return the states of the global generators of numpy and of Python."""
    _, key, *rest = np.random.get_state()  # noqa: NPY002 - this generator is the subject
    return (np.array(key).tobytes(), *rest, random.getstate())
