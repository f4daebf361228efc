"""A rule that drives in highway-env by its kinematics observation, and how to read that."""

from collections.abc import Callable
from math import sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eigenfail_gymnasium.declared import policy
from eigenfail_gymnasium.stages import PolicyTask

HEEDED_M = 6.0
"""Vehicles ahead are heeded up to the next lane, so that one that merges finds a gap."""

LENGTH_M = 5.0
DESIRED_MPS, HEADWAY_S, STANDSTILL_M = 30.0, 1.5, 5.0
MOST_MPS2, COMFORT_MPS2 = 3.0, 3.0


def read_vehicles(task: PolicyTask, observation: NDArray[Any]) -> dict[str, NDArray[np.float64]]:
    """Return the columns of a kinematics observation in physical units.

    Args:
        task: of the episode.
        observation: shape (vehicles, features); the ego is the first row.

    Returns:
        For each feature an array of shape (vehicles,): x and y in m, vx and vy in m/s. Rows of
        other vehicles hold values relative to the ego, unless the environment is configured
        otherwise.

    Raises:
        ValueError: it is another observation.
    """
    if not task.features or observation.ndim != 2:
        message = "the rule needs the observation `Kinematics`"
        raise ValueError(message)
    columns: dict[str, NDArray[np.float64]] = {}
    for place, name in enumerate(task.features):
        low, high = task.ranges.get(name, (-1.0, 1.0))
        columns[name] = low + (observation[:, place].astype(np.float64) + 1.0) * (high - low) / 2.0
    return columns


@policy
def keep_gap(task: PolicyTask) -> Callable[[NDArray[Any]], int]:
    """Drive by the Intelligent Driver Model, with highway-env's actions along the lane.

    The acceleration follows eq. 3 of Treiber, Hennecke and Helbing (2000, Physical Review E 62,
    1805). The vehicle ahead, in the ego's lane or the next, that needs the hardest braking decides.
    """
    actions = task.actions

    def act(observation: NDArray[Any]) -> int:
        seen = read_vehicles(task, observation)
        speed_mps = float(seen["vx"][0])
        there = seen["presence"][1:] > 0.5
        x_m, y_m = seen["x"][1:][there], seen["y"][1:][there]
        closing = -seen["vx"][1:][there]
        least = _accelerate(speed_mps, np.inf, 0.0)
        for ahead_m, aside_m, closing_mps in zip(x_m, np.abs(y_m), closing, strict=True):
            if ahead_m > 0.0 and aside_m < HEEDED_M:
                gap_m = max(ahead_m - LENGTH_M, 0.1)
                least = min(least, _accelerate(speed_mps, gap_m, closing_mps))
        if least < -0.5:
            return actions["SLOWER"]
        return actions["FASTER"] if least > 0.5 else actions["IDLE"]

    return act


def _accelerate(speed_mps: float, gap_m: float, closing_mps: float) -> float:
    """Return the acceleration of the Intelligent Driver Model. [m/s²]"""
    braking = speed_mps * closing_mps / (2.0 * sqrt(MOST_MPS2 * COMFORT_MPS2))
    wanted_m = STANDSTILL_M + max(HEADWAY_S * speed_mps + braking, 0.0)
    free = (speed_mps / DESIRED_MPS) ** 4
    return float(MOST_MPS2 * (1.0 - free - (wanted_m / gap_m) ** 2))
