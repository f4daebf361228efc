"""The adversary's Markov decision process: one decision stays for `hold` steps."""

import msgspec
import numpy as np

from eigenfail.errors import LearnerFailed
from eigenfail.values import EpisodeResult, Floats, Outcome
from eigenfail_services.methods.ast.reward import Reward


class Decisions(msgspec.Struct, frozen=True, eq=False):
    """Transitions at decision times.

    Attributes:
        states: what the adversary saw when it decided, shape (n, 6).
        actions: z / amplitude, in [-1, 1], shape (n, 2).
        rewards: summed over the steps of the decision, shape (n,).
        next_states: what it saw at the next decision, shape (n, 6); its own state at the end.
        ends: 1 for the last decision of an episode, shape (n,).
    """

    states: Floats
    actions: Floats
    rewards: Floats
    next_states: Floats
    ends: Floats


def usable(result: EpisodeResult) -> bool:
    """Whether an episode can be learnt from: it was run to its end by a policy."""
    return (
        result.outcome is not Outcome.FAILED
        and result.steps > 0
        and result.states is not None
        and result.measures is not None
    )


def decisions(result: EpisodeResult, reward: Reward, hold: int, amplitude: float) -> Decisions:
    """The transitions of a usable episode.

    Args:
        result: of an episode whose disturbances a policy chose.
        reward: of every step.
        hold: number of steps for which one action stays.
        amplitude: the policy's largest |z|. [sigma]

    Raises:
        LearnerFailed: a number in the episode is NaN or infinite.
    """
    first = np.arange(0, result.steps, hold)
    states = np.asarray(result.states, np.float32)[first]
    ends = np.zeros(len(first), np.float32)
    ends[-1] = 1.0
    found = Decisions(
        states=states,
        actions=result.noise.z[first] / np.float32(amplitude),
        rewards=np.add.reduceat(reward(result), first).astype(np.float32),
        next_states=np.concatenate([states[1:], states[-1:]]),
        ends=ends,
    )
    if not all(np.isfinite(array).all() for array in (found.states, found.actions, found.rewards)):
        raise LearnerFailed(
            f"Episode {result.index} has a NaN or infinite state, noise or reward.",
            "Look at that episode: its simulator or planner returns such numbers.",
        )
    return found
