"""A quadratic program on OSQP that is solved repeatedly with new vectors.

min ½ xᵀPx + qᵀx subject to l ≤ Ax ≤ u, with P and A fixed. OSQP checks neither sizes nor types and
can say "solved" over a NaN: so the vectors are the program's own, which fit, and both sides are
checked for NaN here. No answer depends on the clock, nor on earlier vectors: rho and the scaling
stay as set up, and only the number of iterations is bounded.
"""

from math import isfinite
from typing import Any

import numpy as np
import osqp
from numpy.typing import NDArray
from scipy import sparse

from eigenfail.errors import SolverError
from eigenfail_workers.planners.rulebook.settings import SolverSettings
from eigenfail_workers.planners.rulebook.values import QpStatus, Solution

Vectors = tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]


def make_solver_options(settings: SolverSettings) -> dict[str, float]:
    """Return the settings by OSQP's names, with everything off that depends on the clock."""
    return {
        "verbose": False,
        "warm_starting": True,
        "polishing": False,
        "adaptive_rho": 0,
        "rho": settings.rho,
        "max_iter": settings.max_iterations,
        "check_termination": settings.check_every,
        "eps_abs": settings.tolerance,
        "eps_rel": settings.tolerance,
    }


def make_solver(
    cost: sparse.csc_matrix,
    constraints: sparse.csc_matrix,
    vectors: Vectors,
    settings: SolverSettings,
) -> Any:
    """Return the solver object of the extension for P (its upper triangle), A and (q, l, u).

    The public `solve()` copies every field of its report into a namespace, which takes longer than
    solving; the object behind it does not. Because the object is private, only releases 1.1 are
    allowed, and a test compares its answers with the public ones.

    Raises:
        SolverError: P is not positive semidefinite.
    """
    public = osqp.OSQP(algebra="builtin")
    linear, lower, upper = vectors
    try:
        public.setup(cost, linear, constraints, lower, upper, **make_solver_options(settings))
    except osqp.OSQPException as refusal:
        message = f"OSQP refuses the program, with its error {refusal.args}."
        raise SolverError(message, "Make P positive semidefinite.") from refusal
    return public._solver  # noqa: SLF001


Vector = NDArray[np.float64]


Matrix = NDArray[np.float64]


STATUS: dict[int, QpStatus] = {
    osqp.SolverStatus.OSQP_SOLVED: QpStatus.SOLVED,
    # An inaccurate answer may break the constraints, and counts as none.
    osqp.SolverStatus.OSQP_SOLVED_INACCURATE: QpStatus.ITERATION_LIMIT,
    osqp.SolverStatus.OSQP_MAX_ITER_REACHED: QpStatus.ITERATION_LIMIT,
    osqp.SolverStatus.OSQP_PRIMAL_INFEASIBLE: QpStatus.INFEASIBLE,
    osqp.SolverStatus.OSQP_PRIMAL_INFEASIBLE_INACCURATE: QpStatus.INFEASIBLE,
    osqp.SolverStatus.OSQP_DUAL_INFEASIBLE: QpStatus.INFEASIBLE,
    osqp.SolverStatus.OSQP_DUAL_INFEASIBLE_INACCURATE: QpStatus.INFEASIBLE,
}
"""Status by the codes of OSQP."""


OPEN = float(osqp.constant("OSQP_INFTY"))
"""The limit of an open side. With an infinite one in its place OSQP does not converge."""


class QuadraticProgram:
    """One problem structure, warm-started from call to call until `reset`.

    Attributes:
        linear: q of shape (n,), to be filled in place before `solve`; zero at first.
        lower: l of shape (m,), likewise; open at first.
        upper: u of shape (m,), likewise; open at first.
    """

    def __init__(self, cost: Matrix, constraints: Matrix, settings: SolverSettings) -> None:
        """cost: P of shape (n, n), symmetric; constraints: A of shape (m, n).

        Raises:
            SolverError: P and A do not fit, or P is not positive semidefinite.
        """
        rows, columns = constraints.shape
        if cost.shape != (columns, columns):
            raise SolverError(f"P is {cost.shape} and A {constraints.shape}.", "Make them fit.")
        # OSQP reads the upper triangle of P alone.
        self._cost = sparse.csc_matrix(np.triu(cost))
        self._constraints = sparse.csc_matrix(constraints)
        self._settings = settings
        self.linear: Vector = np.zeros(columns)
        self.lower: Vector = np.full(rows, -OPEN)
        self.upper: Vector = np.full(rows, OPEN)
        # A cold start in the form of a warm one: it costs no new factorisation.
        self._start = np.zeros(columns), np.zeros(rows)
        self._shares = np.full(columns, 1.0 / columns)
        self.set_up()

    def set_up(self) -> None:
        """Let OSQP scale and factor the matrices again; `reset` does the same in less time."""
        rows, columns = self._constraints.shape
        vectors = np.zeros(columns), np.full(rows, -OPEN), np.full(rows, OPEN)
        self._solver = make_solver(self._cost, self._constraints, vectors, self._settings)
        self._report = self._solver.info  # the same object after each run

    def reset(self) -> None:
        """Forget the last answer, so that later answers do not depend on earlier calls."""
        self._solver.warm_start(*self._start)

    def solve(self) -> Solution:
        """Solve for the present vectors."""
        linear, lower, upper, solver = self.linear, self.lower, self.upper, self._solver
        # No comparison holds with a NaN, so one that holds everywhere settles both.
        ordered = np.count_nonzero(lower <= upper) == lower.size
        if not (ordered and self._is_finite(linear)):
            return Solution(_objection(linear, lower, upper))
        # Both return an error code, and 0 if there is none.
        if solver.update_data_vec(linear, lower, upper) or solver.solve():
            return self._fail(QpStatus.OTHER)
        return self._answer()

    def _is_finite(self, vector: Vector) -> bool:
        """Return whether all numbers are finite.

        If their mean is finite, they are. The mean takes a fraction of the time and cannot
        overflow.
        """
        return isfinite(vector.dot(self._shares))

    def _answer(self) -> Solution:
        status = STATUS.get(self._report.status_val, QpStatus.OTHER)
        if status is not QpStatus.SOLVED:
            return self._fail(status)
        x: Vector = self._solver.solution.x
        return Solution(status, x) if self._is_finite(x) else self._fail(QpStatus.NOT_FINITE)

    def _fail(self, status: QpStatus) -> Solution:
        """Reset the solver, and return a solution with the status alone.

        After a failed run, a warm start from the last iterate may never recover.
        """
        self.reset()
        return Solution(status)

    @property
    def run_s(self) -> float:
        """Time that OSQP reports for its last run."""
        return float(self._report.run_time)


def _objection(linear: Vector, lower: Vector, upper: Vector) -> QpStatus:
    """Return the status of vectors that are not passed to the solver."""
    known = np.isfinite(linear).all() and not np.isnan(lower).any() and not np.isnan(upper).any()
    return QpStatus.INFEASIBLE if known else QpStatus.NOT_FINITE
