"""The adversary's Markov decision process: one decision stays for `hold` steps."""

import msgspec
import numpy as np
from numpy.typing import NDArray

from eigenfail.errors import LearnerFailed
from eigenfail.values.arrays import Floats
from eigenfail.values.episode import EpisodeResult, Outcome
from eigenfail_services.methods.ast.reward import Reward

FINAL_AMPLITUDE_SHARE = 0.5
"""Share of a campaign's episodes after which the amplitude has its last value."""


class AmplitudeSchedule(msgspec.Struct, frozen=True):
    """Largest |z| of the policy, which changes linearly from its first value to its last.

    Attributes:
        first: amplitude at the start of the campaign. [sigma]
        last: amplitude in the second half, and for a policy that is only used. [sigma]
        episodes: budget of the campaign.
    """

    first: float
    last: float
    episodes: int

    def get_amplitude(self, episode: int) -> float:
        """Return the amplitude of the round that begins with an episode, counted from 0. [sigma]"""
        if self.is_final(episode):
            return self.last
        return self.first + (self.last - self.first) * episode / (
            FINAL_AMPLITUDE_SHARE * self.episodes
        )

    def is_final(self, episode: int) -> bool:
        """Whether the amplitude is constant from an episode on."""
        return self.first == self.last or episode >= FINAL_AMPLITUDE_SHARE * self.episodes


class Decisions(msgspec.Struct, frozen=True, eq=False):
    """Transitions at decision times.

    Attributes:
        states: observed at the decision, shape (n, count_state(channels)).
        actions: z / amplitude, in [-1, 1], shape (n, channels).
        rewards: sum over the steps of `n_step` decisions from this one on, shape (n,).
        next_states: observed `n_step` decisions later, or at the last one, like `states`.
        ends: 1 where the episode ended within these decisions, shape (n,).
    """

    states: Floats
    actions: Floats
    rewards: Floats
    next_states: Floats
    ends: Floats


class DecisionProcess(msgspec.Struct, frozen=True):
    """Grouping of steps into decisions, and of decisions into transitions.

    Attributes:
        hold: number of steps for which one action stays.
        n_step: number of decisions whose rewards are summed (Sutton and Barto 2018, chapter 7). The
            entropy of those in between is neglected, and so is that other policies made them.
        gamma: discount from decision to decision.
    """

    hold: int
    n_step: int = 1
    gamma: float = 1.0


def is_usable(result: EpisodeResult) -> bool:
    """Whether an episode can be learnt from: a policy has disturbed it to its end."""
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
        reward: reward of every step.
        process: grouping of steps and decisions.
        amplitude: the policy's largest |z|. [sigma]

    Raises:
        LearnerFailed: a number in the episode is NaN or infinite.
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
