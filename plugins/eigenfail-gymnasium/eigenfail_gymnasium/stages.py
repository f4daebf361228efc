"""Stages of episodes: the environments behind the simulator."""

from collections.abc import Mapping
from typing import Any, NamedTuple, Protocol

from gymnasium.spaces import Space

from eigenfail.values.scene import Control, Mission, Observation, Perception


class PolicyTask(NamedTuple):
    """The task that a policy gets before an episode.

    Attributes:
        observation_space: of the environment.
        action_space: of the environment.
        dt_s: duration of a step. [s]
        actions: numbers of highway-env's discrete actions by name, such as `SLOWER`; else empty.
        features: columns of highway-env's kinematics observation; else empty.
        ranges: by feature, the values that the observation shows as -1 and 1, in metres and metres
            a second; empty if the observation is not normalised.
    """

    observation_space: Space[Any]
    action_space: Space[Any]
    dt_s: float
    actions: Mapping[str, int]
    features: tuple[str, ...]
    ranges: Mapping[str, tuple[float, float]]


class ChosenAction:
    """Holds the action of a policy, since a control is not an action of an environment."""

    action: Any = None


class ObservedPerception(Perception, frozen=True, kw_only=True):
    """A perception with what a policy of Gymnasium needs.

    Attributes:
        observation: what the environment shows of the perceived world, with the errors of
            channels `observation.N`.
        task: task that the policy gets.
        decision: receives the action of the policy.
    """

    observation: Any
    task: PolicyTask
    decision: ChosenAction


class Advance(NamedTuple):
    """An environment after a step.

    Attributes:
        now: the truth.
        is_over: whether the environment ended the episode.
    """

    now: Observation
    is_over: bool


class Stage(Protocol):
    """An environment, as the simulator stages it.

    Attributes:
        mission: briefing of planners other than policies.
        takes_controls: whether a `Control` can drive the ego.
    """

    mission: Mission
    takes_controls: bool

    def reset(self, seed: int) -> Observation:
        """Begin an episode, and return its start."""

    def observe(self, perception: Perception) -> Any:
        """Return the environment's observation of the perceived world."""

    def describe(self) -> PolicyTask:
        """Return the task that a policy gets."""

    def advance(self, before: Observation, answer: Control | ChosenAction) -> Advance:
        """Do one step."""

    def close(self) -> None:
        """Release the environment."""


def read_action(answer: ChosenAction, space: Space[Any]) -> Any:
    """Return the action of a decision in the form that the environment takes.

    Raises:
        ValueError: it is not an action of the environment.
    """
    action = answer.action
    if type(space).__name__ == "Discrete" and getattr(action, "ndim", None) == 0:
        action = int(action)
    if not space.contains(action):
        message = f"the policy answered {action!r}, which is not in {space}"
        raise ValueError(message)
    return action
