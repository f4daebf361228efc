"""Environments that are not roads: their margin to a failure, shown as a distance of two squares.

Measures, methods and pages work with distances between footprints. Here the ego is a square of 1 m
that does not move. One further square is as many metres in front of it as the margin says. They
touch at a failure.
"""

from collections.abc import Callable
from math import isfinite
from typing import Any

from eigenfail.errors import InvalidValue, SimulatorError
from eigenfail.values.scene import Control, Mission, Observation, Perception, VehicleState
from eigenfail_gymnasium.environments import FIELD, Environment, GymnasiumParameters
from eigenfail_gymnasium.stages import Advance, ChosenAction, PolicyTask, read_action

SIZE_M = 1.0
SAFE_M = 1.0
"""Distance that stands for an episode that has not failed, where no margin is named."""

STANDING = Control(0.0, 0.0)


class MarginStage:
    """An environment that is not a road. Implements `Stage`.

    Args:
        env: the environment.
        parameters: what counts as its failure.
        measure: the declared margin; None without one.
        dt_s: duration of a step. [s]
    """

    takes_controls = False

    def __init__(
        self,
        env: Environment,
        parameters: GymnasiumParameters,
        measure: Callable[[Any, dict[str, Any]], float] | None,
        dt_s: float,
    ) -> None:
        self._env = env
        self._failure_key = parameters.failure_key
        self._measure = measure
        self._seen: Any = None
        self.mission = Mission(dt_s, 1, 4.0, 1.0, 1.0, 0.0)

    def reset(self, seed: int) -> Observation:
        """Begin an episode."""
        self._seen, info = self._env.reset(seed=seed)
        return self._show(0, False, info)

    def describe(self) -> PolicyTask:
        """Return the task that a policy gets."""
        spaces = self._env.observation_space, self._env.action_space
        return PolicyTask(*spaces, self.mission.dt_s, {}, (), {})

    def observe(self, perception: Perception) -> Any:  # noqa: ARG002 - of the contract
        """Return the observation of the last step."""
        return self._seen

    def advance(self, before: Observation, answer: Control | ChosenAction) -> Advance:
        """Do one step of the environment.

        Raises:
            ValueError: the policy's answer is not an action of the environment.
            InvalidValue: `info` lacks the entry `failure_key`.
        """
        action = (
            read_action(answer, self._env.action_space) if isinstance(answer, ChosenAction) else 0
        )
        self._seen, _, terminated, truncated, info = self._env.step(action)
        now = self._show(before.step + 1, bool(terminated), info)
        return Advance(now, bool(terminated or truncated))

    def _show(self, step: int, terminated: bool, info: dict[str, Any]) -> Observation:
        left_m = self._find_margin(terminated, info)
        has_failed = left_m <= 0.0
        # From centre to centre.
        ahead_m = SIZE_M + max(left_m, 0.0)
        other = VehicleState(ahead_m, 0.0, 0.0, 0.0, SIZE_M, SIZE_M)
        ego = VehicleState(0.0, 0.0, 0.0, 0.0, SIZE_M, SIZE_M)
        control = STANDING if step else None
        return Observation(step, ego, (other,), collided=has_failed, control=control)

    def _find_margin(self, terminated: bool, info: dict[str, Any]) -> float:
        """Return the margin to a failure, which is one at 0 or less."""
        if self._measure is not None:
            left = float(self._measure(self._env.unwrapped, info))
            if not isfinite(left):
                problem = f"The margin is {left}."
                raise SimulatorError(problem, "It must return a finite number.")
            return left
        if not terminated:
            return SAFE_M
        if not self._failure_key:
            return 0.0
        if self._failure_key not in info:
            names = ", ".join(sorted(map(str, info))) or "none"
            problem = f"`info` has no '{self._failure_key}' at the end of an episode."
            raise InvalidValue(f"{FIELD}.failure_key", problem, f"It has: {names}.")
        return 0.0 if info[self._failure_key] else SAFE_M

    def close(self) -> None:
        """Close the environment."""
        self._env.close()
