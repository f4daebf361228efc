"""The adversary's Markov decision process: rewards, and decisions that last for `hold` steps.

Rewards are objects that can be compared with each other.
"""

from collections.abc import Sequence
from typing import Protocol, Self

import msgspec
import numpy as np
from numpy.typing import NDArray

from eigenfail.errors import LearnerFailed
from eigenfail.values.arrays import Floats
from eigenfail.values.episode import EpisodeResult, Outcome
from eigenfail_services.methods.archive import Arrays

Rewards = NDArray[np.float64]


class Reward(Protocol):
    """Rewards of the steps of a completed episode."""

    def __call__(self, result: EpisodeResult) -> Rewards:
        """Return the reward of each step, shape (steps,)."""

    def update(self, results: Sequence[EpisodeResult]) -> "Reward":
        """Return the reward of later episodes, which takes these into account."""

    def arrays(self) -> Arrays:
        """Return the data that the reward has kept from earlier episodes."""

    def load(self, arrays: Arrays) -> "Reward":
        """Return the reward in the state that the arrays describe.

        Raises:
            ValueError: an array is missing or has another shape.
        """


class ConstantReward(msgspec.Struct, frozen=True):
    """A reward that does not depend on earlier episodes."""

    def update(self, _results: Sequence[EpisodeResult]) -> Self:
        """Return the same reward."""
        return self

    def arrays(self) -> Arrays:
        """Return no arrays."""
        return {}

    def load(self, _arrays: Arrays) -> Self:
        """Return the same reward."""
        return self


class PaperReward(ConstantReward, frozen=True):
    """The paper's reward (eq. 4; Lee et al. 2020, Adaptive Stress Testing, JAIR 69).

    0 at a terminal failure, -alpha - c_dist · d_min at any other end, log p(a_t) at all other
    steps; d_min is the episode's robustness [m].
    """

    alpha: float
    c_dist: float

    def __call__(self, result: EpisodeResult) -> Rewards:
        """Return the reward of each step, shape (steps,)."""
        # The reward of the end replaces log p of the last step: the cases of equation 4 exclude
        # each other.
        rewards = result.noise.log_probability_per_step.copy()
        rewards[-1] = _reward_at_end(result, self.alpha, self.c_dist)
        return rewards


class MahalanobisReward(ConstantReward, frozen=True):
    """Koren et al. 2018 (Adaptive Stress Testing for Autonomous Vehicles, IEEE IV).

    -log(1 + M(a_t)) in place of log p(a_t), M the Mahalanobis distance from the mean: ||z_t||. It
    needs only a covariance instead of a density, and large disturbances cost little more than
    medium ones. The reward at the end is the paper's.
    """

    alpha: float
    c_dist: float

    def __call__(self, result: EpisodeResult) -> Rewards:
        """Return the reward of each step, shape (steps,)."""
        distances = np.linalg.norm(result.noise.counted_z.astype(np.float64), axis=1)
        rewards: Rewards = -np.log1p(distances)
        rewards[-1] = _reward_at_end(result, self.alpha, self.c_dist)
        return rewards


def _reward_at_end(result: EpisodeResult, alpha: float, c_dist: float) -> float:
    """Return 0 for a failure, otherwise -alpha - c_dist · robustness [m]."""
    if result.is_failure:
        return 0.0
    d_min = result.measures.robustness_m if result.measures else float("nan")
    return -alpha - c_dist * d_min


MAX_FAILURES = 100
"""Number of the newest failures that are compared: older ones stem from outdated policies."""


class DissimilarityReward(msgspec.Struct, frozen=True, eq=False):
    """Corso et al. 2019 (AST with Reward Augmentation, IEEE ITSC): trajectory dissimilarity.

    To prevent mode collapse, a terminal failure earns c_dissimilarity · d instead of 0. d is the
    distance from the nearest known failure [sigma]: the root mean square over steps and channels of
    the difference in z. After an episode's end, z is 0. For the first failure, d = 0. Corso et al.
    compare trajectories of states; noise can be compared without a simulator.

    Attributes:
        paper: reward of all other steps.
        c_dissimilarity: bonus per sigma.
        failures: known failures, shape (n, horizon, channels). [sigma]
    """

    paper: PaperReward
    c_dissimilarity: float
    failures: Floats

    def __call__(self, result: EpisodeResult) -> Rewards:
        """Return the reward of each step, shape (steps,)."""
        rewards = self.paper(result)
        if result.is_failure:
            rewards[-1] += self.c_dissimilarity * self.measure_distance(result)
        return rewards

    def measure_distance(self, result: EpisodeResult) -> float:
        """Return the distance from the nearest known failure. [sigma]"""
        if not len(self.failures):
            return 0.0
        differences = self.failures - self._pad(result)
        return float(np.sqrt(np.square(differences).mean(axis=(1, 2)).min()))

    def update(self, results: Sequence[EpisodeResult]) -> "DissimilarityReward":
        """Return the reward with new failures added and the oldest ones dropped."""
        found = [self._pad(result)[None] for result in results if result.is_failure]
        failures = np.concatenate([self.failures, *found])[-MAX_FAILURES:]
        return msgspec.structs.replace(self, failures=failures)

    def arrays(self) -> Arrays:
        """Return the known failures."""
        return {"failures": self.failures}

    def load(self, arrays: Arrays) -> "DissimilarityReward":
        """Return the reward with known failures from arrays.

        Raises:
            ValueError: the failures are missing or have another length.
        """
        failures = arrays.get("failures")
        if failures is None or failures.shape[1:] != self.failures.shape[1:]:
            raise ValueError("there are no failures of this horizon")
        return msgspec.structs.replace(self, failures=failures)

    def _pad(self, result: EpisodeResult) -> Floats:
        """Return z up to the horizon, shape (horizon, channels)."""
        z = np.zeros(self.failures.shape[1:], np.float32)
        z[: result.steps] = result.noise.counted_z
        return z


class Decisions(msgspec.Struct, frozen=True, eq=False):
    """Transitions at decision times.

    Attributes:
        states: observed at the decision, shape (n, count_state(channels)).
        actions: z / amplitude, in [-1, 1], shape (n, channels).
        rewards: sum over the steps of `n_step` decisions from this one on, shape (n,).
        next_states: observed `n_step` decisions later, or at the last decision, like `states`.
        ends: 1 if the episode ended within the summed decisions, shape (n,).
    """

    states: Floats
    actions: Floats
    rewards: Floats
    next_states: Floats
    ends: Floats


class DecisionProcess(msgspec.Struct, frozen=True):
    """Grouping of steps into decisions, and of decisions into transitions.

    Attributes:
        hold: number of steps for which an action is held.
        n_step: number of decisions whose rewards are summed (Sutton and Barto 2018, chapter 7). The
            entropy of the decisions in between is neglected, and also the fact that other policies
            made them.
        gamma: discount from decision to decision.
    """

    hold: int
    n_step: int = 1
    gamma: float = 1.0


def is_usable(result: EpisodeResult) -> bool:
    """Return whether a learner can use an episode: a policy has disturbed it to its end."""
    return (
        result.outcome is not Outcome.ERRORED
        and result.steps > 0
        and result.states is not None
        and result.measures is not None
    )


def make_decisions(
    result: EpisodeResult, reward: Reward, process: DecisionProcess, amplitude: float
) -> Decisions:
    """Return the transitions of a usable episode.

    Args:
        result: result of an episode that a policy has disturbed.
        reward: reward of each step.
        process: grouping of steps and decisions.
        amplitude: the policy's largest |z|. [sigma]

    Raises:
        LearnerFailed: a value in the episode is NaN or infinite.
    """
    first = np.arange(0, result.steps, process.hold)
    states = np.asarray(result.states, np.float32)[first]
    behind = np.arange(len(first)) + process.n_step
    rewards = np.add.reduceat(reward(result), first)
    found = Decisions(
        states=states,
        # The noise as it was injected, not as the policy says now: it may have been trained since.
        actions=result.noise.z[first] / np.float32(amplitude),
        rewards=sum_discounted_rewards(rewards, process.n_step, process.gamma).astype(np.float32),
        # Behind the end any state will do: `ends` switches its value off.
        next_states=states[np.minimum(behind, len(first) - 1)],
        ends=(behind >= len(first)).astype(np.float32),
    )
    if not all(np.isfinite(array).all() for array in (found.states, found.actions, found.rewards)):
        raise LearnerFailed(
            f"Episode {result.index} has a NaN or infinite state, noise or reward.",
            "Look at that episode: its simulator or planner returns such numbers.",
        )
    return found


def sum_discounted_rewards(
    rewards: NDArray[np.float64], n_step: int, gamma: float
) -> NDArray[np.float64]:
    """Return the sum over k < n_step of gamma^k · r_{t+k}, for every t.

    Rewards after the end are 0. Rewards and sums are of shape (decisions,).
    """
    sums = np.zeros_like(rewards)
    for k in range(min(n_step, len(rewards))):
        sums[: len(rewards) - k] += gamma**k * rewards[k:]
    return sums
