"""The quadratic program that makes the chosen candidate smooth and keeps its distance.

Variables: the accelerations a_0 … a_{N-1} over the knots, and one slack s [m].

    min  Σ (a_k − r_k)² + w_jerk Σ (a_k − a_{k−1})² + w_slack s² + v_slack s
    s.t. a_min ≤ a_k ≤ a_max,  |a_k − a_{k−1}| ≤ jerk · h,  way_k ≤ gap_k − margin + s,  s ≥ 0

with r the candidate's accelerations, a_{−1} the one in force, and way_k, the way at the end of
knot k, linear in a.
"""

from typing import Annotated

import msgspec
import numpy as np
from msgspec import Meta

from eigenfail_workers.planners.rulebook.candidates import KNOT_S, KNOTS, Profile, Start
from eigenfail_workers.planners.rulebook.quadratic_program import (
    Matrix,
    QpStatus,
    QuadraticProgram,
    SolverSettings,
)
from eigenfail_workers.planners.rulebook.surroundings import Neighbour
from eigenfail_workers.planners.rulebook.truck import TruckLimits

FREE_M = 1e4
"""Room ahead where there is no lead [m]."""

VARIABLES = KNOTS + 1
ACCELERATION = slice(0, KNOTS)
JERK = slice(KNOTS, 2 * KNOTS)
WAY = slice(2 * KNOTS, 3 * KNOTS)
SLACK = 3 * KNOTS
ROWS = 3 * KNOTS + 1
TIMES_S = KNOT_S * np.arange(1, KNOTS + 1)


class RefineSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Weights of the program.

    Attributes:
        jerk_weight: of a change of the acceleration against a departure from the candidate.
        slack_weight: of a squared metre too near to the lead.
        slack_price: of a metre too near to the lead.
        margin_m: gap to be kept to the lead over the horizon.
    """

    jerk_weight: Annotated[float, Meta(ge=0.0, le=1e3)] = 0.3
    slack_weight: Annotated[float, Meta(gt=0.0, le=1e3)] = 0.1
    slack_price: Annotated[float, Meta(ge=0.0, le=1e3)] = 0.5
    margin_m: Annotated[float, Meta(ge=0.0, le=30.0)] = 4.0
    solver: SolverSettings = SolverSettings()


class Refiner:
    """Holds the program; `reset` makes it forget everything."""

    def __init__(self, settings: RefineSettings, limits: TruckLimits) -> None:
        self._settings = settings
        self._limits = limits
        self._program = QuadraticProgram(_cost(settings), _constraints(), settings.solver)
        self._linear = np.zeros(VARIABLES)
        self._lower = np.full(ROWS, -np.inf)
        self._upper = np.full(ROWS, np.inf)

    def reset(self) -> None:
        """A new episode begins."""
        self._program.reset()

    def __call__(
        self, profile: Profile, start: Start, lead: Neighbour | None
    ) -> tuple[QpStatus, float | None]:
        """The acceleration over the first knot [m/s²]; None unless the program was solved."""
        self._fill_cost(profile, start)
        self._fill_limits(start)
        self._fill_room(start, lead)
        solution = self._program.solve(self._linear, self._lower, self._upper)
        return solution.status, None if solution.x is None else float(solution.x[0])

    def _fill_cost(self, profile: Profile, start: Start) -> None:
        linear = self._linear
        linear[ACCELERATION] = profile.accelerations
        linear[ACCELERATION] *= -2.0
        linear[0] -= 2.0 * self._settings.jerk_weight * start.acceleration_mps2
        linear[KNOTS] = self._settings.slack_price

    def _fill_limits(self, start: Start) -> None:
        limits, lower, upper = self._limits, self._lower, self._upper
        change = limits.comfort_jerk_mps3 * KNOT_S
        # What is in force after an emergency may lie outside the comfortable limits.
        lower[ACCELERATION] = -limits.peak_braking_mps2
        upper[ACCELERATION] = start.task.max_acceleration_mps2
        lower[JERK] = -change
        upper[JERK] = change
        lower[KNOTS] += start.acceleration_mps2
        upper[KNOTS] += start.acceleration_mps2
        lower[SLACK] = 0.0

    def _fill_room(self, start: Start, lead: Neighbour | None) -> None:
        if lead is None:
            self._upper[WAY] = FREE_M
            return
        room = lead.gap_m - self._settings.margin_m
        self._upper[WAY] = room + (lead.speed_mps - start.speed_mps) * TIMES_S


def _cost(settings: RefineSettings) -> Matrix:
    """P, from the sum of squares: twice its Gram matrix."""
    change = np.eye(KNOTS) - np.eye(KNOTS, k=-1)
    cost: Matrix = np.zeros((VARIABLES, VARIABLES))
    cost[:KNOTS, :KNOTS] = 2.0 * (np.eye(KNOTS) + settings.jerk_weight * change.T @ change)
    cost[KNOTS, KNOTS] = 2.0 * settings.slack_weight
    return cost


def _constraints() -> Matrix:
    """A: accelerations, their changes, the ways less the slack, the slack."""
    knots = np.arange(KNOTS)
    ahead = np.maximum(knots[:, None] - knots[None, :] + 0.5, 0.0)
    rows: Matrix = np.zeros((ROWS, VARIABLES))
    rows[ACCELERATION, :KNOTS] = np.eye(KNOTS)
    rows[JERK, :KNOTS] = np.eye(KNOTS) - np.eye(KNOTS, k=-1)
    rows[WAY, :KNOTS] = ahead * KNOT_S**2
    rows[WAY, KNOTS] = -1.0
    rows[SLACK, KNOTS] = 1.0
    return rows
