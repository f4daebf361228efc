"""The adversary's Markov decision process: one decision stays for `hold` steps."""

import msgspec
import numpy as np
from numpy.typing import NDArray

from eigenfail.errors import LearnerFailed
from eigenfail.values import EpisodeResult, Floats, Outcome
from eigenfail_services.methods.ast.reward import Reward


class Decisions(msgspec.Struct, frozen=True, eq=False):
    """Transitions at decision times.

    Attributes:
        states: what the adversary saw when it decided, shape (n, len(STATE)).
        actions: z / amplitude, in [-1, 1], shape (n, 2).
        rewards: summed over the steps of `n_step` decisions, this one and the next, shape (n,).
        next_states: what it saw `n_step` decisions later, or at the last one, like `states`.
        ends: 1 where the episode ended within these decisions, shape (n,).
    """

    states: Floats
    actions: Floats
    rewards: Floats
    next_states: Floats
    ends: Floats


class DecisionProcess(msgspec.Struct, frozen=True):
    """How steps make decisions, and decisions make transitions.

    Attributes:
        hold: number of steps for which one action stays.
        n_step: decisions whose rewards are summed (Sutton and Barto 2018, chapter 7). The entropy
            of those in between is left out, and so is that other policies chose them.
        gamma: discount from decision to decision.
    """

    hold: int
    n_step: int = 1
    gamma: float = 1.0


def usable(result: EpisodeResult) -> bool:
    """Whether an episode can be learnt from: it was run to its end by a policy."""
    return (
        result.outcome is not Outcome.FAILED
        and result.steps > 0
        and result.states is not None
        and result.measures is not None
    )


def decisions(
    result: EpisodeResult, reward: Reward, given: DecisionProcess, amplitude: float
) -> Decisions:
    """The transitions of a usable episode.

    Args:
        result: of an episode whose disturbances a policy chose.
        reward: of every step.
        given: how steps make decisions, and decisions make transitions.
        amplitude: the policy's largest |z|. [sigma]

    Raises:
        LearnerFailed: a number in the episode is NaN or infinite.
    """
    first = np.arange(0, result.steps, given.hold)
    states = np.asarray(result.states, np.float32)[first]
    behind = np.arange(len(first)) + given.n_step
    rewards = np.add.reduceat(reward(result), first)
    found = Decisions(
        states=states,
        actions=result.noise.z[first] / np.float32(amplitude),
        rewards=discounted_sums(rewards, given.n_step, given.gamma).astype(np.float32),
        next_states=states[np.minimum(behind, len(first) - 1)],
        ends=(behind >= len(first)).astype(np.float32),
    )
    if not all(np.isfinite(array).all() for array in (found.states, found.actions, found.rewards)):
        raise LearnerFailed(
            f"Episode {result.index} has a NaN or infinite state, noise or reward.",
            "Look at that episode: its simulator or planner returns such numbers.",
        )
    return found


def discounted_sums(rewards: NDArray[np.float64], n_step: int, gamma: float) -> NDArray[np.float64]:
    """sum over k < n_step of gamma^k · r_{t+k}, for every t; nothing is earned after the end.

    The rewards are of shape (decisions,), and so are the sums.
    """
    sums = np.zeros_like(rewards)
    for k in range(min(n_step, len(rewards))):
        sums[: len(rewards) - k] += gamma**k * rewards[k:]
    return sums
