"""The quadratic program that makes the chosen candidate smooth and keeps its distance.

Variables: the accelerations a_0 … a_{N-1} over N knots of h seconds, and one slack s [m].

    min  Σ h (a_k − r_k)² + w_jerk Σ h ((a_k − a_{k−1}) / h)² + w_slack s² + v_slack s
    s.t. a_min ≤ a_k ≤ a_max,  |a_k − a_{k−1}| ≤ jerk · h,  way_k ≤ gap_k − margin + s,  s ≥ 0

with r the candidate's accelerations, a_{−1} the one in force, and way_k, the way at the end of
knot k, linear in a. The sums stand for integrals over time: more knots are the same program, finer.
"""

from typing import Final

import numpy as np

from eigenfail_workers.planners.rulebook.candidates import KNOT_S, KNOTS
from eigenfail_workers.planners.rulebook.quadratic_program import Matrix, QuadraticProgram
from eigenfail_workers.planners.rulebook.settings import RefineSettings, TruckLimits
from eigenfail_workers.planners.rulebook.values import Neighbour, PlanStart, Profile, QpStatus

FREE_M: Final = 1e4
"""Distance ahead without a lead. [m]"""


class Refiner:
    """The program with its warm start, which `reset` forgets."""

    def __init__(self, settings: RefineSettings, limits: TruckLimits) -> None:
        knots, knot_s = settings.knots, settings.knot_s
        self._settings = settings
        self._change = limits.comfort_jerk_mps3 * knot_s
        self._times_s = knot_s * np.arange(1, knots + 1)
        # The terms of (a_k − r_k)² and (a_0 − a_{−1})² that are linear in a.
        self._follow = -2.0 * knot_s * candidate_shares(settings)
        self._continue = -2.0 * settings.jerk_weight / knot_s
        self._first = first_shares(settings)
        # Only vectors change from step to step: the matrices are scaled and factored once.
        self._program = QuadraticProgram(_cost(settings), _constraints(settings), settings.solver)
        self._allocate(limits)

    def _allocate(self, limits: TruckLimits) -> None:
        """Fill q, l, u with their constant values, and make views of the values that change."""
        knots, program = self._settings.knots, self._program
        linear, lower, upper = program.linear, program.lower, program.upper
        linear[knots] = self._settings.slack_price
        # The acceleration after an emergency may lie outside the comfortable limits.
        lower[:knots] = -limits.peak_braking_mps2
        lower[knots : 2 * knots] = -self._change
        upper[knots : 2 * knots] = self._change
        lower[3 * knots] = 0.0
        self._pull, self._highest = linear[:knots], upper[:knots]
        self._least_change = lower[knots : knots + 1]
        self._most_change = upper[knots : knots + 1]
        self._room = upper[2 * knots : 3 * knots]

    def reset(self) -> None:
        """Forget the warm start, for a new episode."""
        self._program.reset()

    def __call__(
        self, profile: Profile, start: PlanStart, lead: Neighbour | None
    ) -> tuple[QpStatus, float | None]:
        """Return the mean acceleration over the first knot [m/s²]; None unless solved."""
        self._fill(profile, start)
        self._fill_room(start, lead)
        solution = self._program.solve()
        x = solution.x
        return solution.status, None if x is None else float(self._first.dot(x))

    def _fill(self, profile: Profile, start: PlanStart) -> None:
        now = start.acceleration_mps2
        np.dot(self._follow, profile.accelerations, out=self._pull)
        self._pull[0] += self._continue * now
        # Set in every step, with the mode; the lower limits are the truck's, and stay.
        self._highest.fill(start.task.max_acceleration_mps2)
        self._least_change[0] = now - self._change
        self._most_change[0] = now + self._change

    def _fill_room(self, start: PlanStart, lead: Neighbour | None) -> None:
        if lead is None:
            self._room.fill(FREE_M)
            return
        # `way_k` of the constraints is the way beyond that at the present speed, so that A stays
        # constant: the present speed is taken from the lead's way here.
        np.multiply(self._times_s, lead.speed_mps - start.speed_mps, out=self._room)
        self._room += lead.gap_m - self._settings.margin_m


def candidate_shares(settings: RefineSettings) -> Matrix:
    """Return the share of each knot (row) in each knot of the candidate (column); rows sum to 1."""
    ends_s = settings.knot_s * np.arange(settings.knots + 1)
    borders_s = KNOT_S * np.arange(KNOTS + 1)
    # Beyond its horizon the candidate's last acceleration goes on.
    borders_s[-1] = np.inf
    common_s = np.minimum.outer(ends_s[1:], borders_s[1:])
    common_s -= np.maximum.outer(ends_s[:-1], borders_s[:-1])
    shares: Matrix = np.maximum(common_s, 0.0) / settings.knot_s
    return shares


def first_shares(settings: RefineSettings) -> Matrix:
    """Return the weights of the variables in the mean acceleration over the first knot."""
    shares = candidate_shares(settings)[:, 0]
    weights: Matrix = np.append(shares / shares.sum(), 0.0)
    return weights


def _cost(settings: RefineSettings) -> Matrix:
    """Return P: twice the Gram matrices of the sums of squares."""
    knots, knot_s = settings.knots, settings.knot_s
    change = np.eye(knots) - np.eye(knots, k=-1)
    cost: Matrix = np.zeros((knots + 1, knots + 1))
    cost[:knots, :knots] = 2.0 * knot_s * np.eye(knots)
    cost[:knots, :knots] += 2.0 * settings.jerk_weight / knot_s * change.T @ change
    cost[knots, knots] = 2.0 * settings.slack_weight
    return cost


def _constraints(settings: RefineSettings) -> Matrix:
    """Return A: accelerations, their changes, distances minus slack, slack."""
    knots, each = settings.knots, np.eye(settings.knots)
    order = np.arange(knots)
    # A unit of a_j, constant over knot j, adds h² / 2 to the way by the end of that knot, and h²
    # more by the end of each later one.
    ahead = np.maximum(order[:, None] - order[None, :] + 0.5, 0.0)
    rows: Matrix = np.zeros((3 * knots + 1, knots + 1))
    rows[:knots, :knots] = each
    rows[knots : 2 * knots, :knots] = each - np.eye(knots, k=-1)
    rows[2 * knots : 3 * knots, :knots] = ahead * settings.knot_s**2
    rows[2 * knots : 3 * knots, knots] = -1.0
    rows[3 * knots, knots] = 1.0
    return rows
