"""A quadratic program on OSQP that is solved repeatedly with new vectors.

min ½ xᵀPx + qᵀx subject to l ≤ Ax ≤ u, with P and A fixed. OSQP checks neither sizes nor types and
can say "solved" over a NaN, so both sides are checked here. No answer depends on the clock, nor
on earlier vectors: rho and the scaling stay as set up, and only the number of iterations
is bounded.
"""

from typing import Any

import msgspec
import numpy as np
import osqp
from numpy.typing import NDArray
from scipy import sparse

from eigenfail.errors import SolverError
from eigenfail_workers.planners.rulebook.settings import SolverSettings
from eigenfail_workers.planners.rulebook.values import QpStatus

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
    solving; the object behind it does not. As it is private, only releases 1.1 are allowed, and a
    test compares its answers with the public ones.

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
    osqp.SolverStatus.OSQP_SOLVED_INACCURATE: QpStatus.ITERATION_LIMIT,
    osqp.SolverStatus.OSQP_MAX_ITER_REACHED: QpStatus.ITERATION_LIMIT,
    osqp.SolverStatus.OSQP_PRIMAL_INFEASIBLE: QpStatus.INFEASIBLE,
    osqp.SolverStatus.OSQP_PRIMAL_INFEASIBLE_INACCURATE: QpStatus.INFEASIBLE,
    osqp.SolverStatus.OSQP_DUAL_INFEASIBLE: QpStatus.INFEASIBLE,
    osqp.SolverStatus.OSQP_DUAL_INFEASIBLE_INACCURATE: QpStatus.INFEASIBLE,
}
"""Status by the codes of OSQP."""


class Solution(msgspec.Struct, frozen=True, eq=False):
    """An answer of shape (variables,), or None and the status that explains it.

    Attributes:
        run_s: time that OSQP reports.
    """

    status: QpStatus
    x: Vector | None = None
    iterations: int = 0
    run_s: float = 0.0


class QuadraticProgram:
    """One problem structure, warm-started from call to call until `reset`."""

    def __init__(self, cost: Matrix, constraints: Matrix, settings: SolverSettings) -> None:
        """cost: P of shape (n, n), symmetric; constraints: A of shape (m, n).

        Raises:
            SolverError: P and A do not fit, or P is not positive semidefinite.
        """
        rows, columns = constraints.shape
        if cost.shape != (columns, columns):
            raise SolverError(f"P is {cost.shape} and A {constraints.shape}.", "Make them fit.")
        self._cost = sparse.csc_matrix(np.triu(_checked(cost, cost.shape)))
        self._constraints = sparse.csc_matrix(_checked(constraints, constraints.shape))
        self._settings = settings
        self._shapes = (columns,), (rows,), (rows,)
        self._highest = np.full(rows, osqp.constant("OSQP_INFTY"))
        self._lowest = -self._highest
        self._limits = np.empty(rows), np.empty(rows)
        self._start = np.zeros(columns), np.zeros(rows)
        self.set_up()

    def set_up(self) -> None:
        """Let OSQP scale and factor the matrices again; `reset` does the same in less time."""
        vectors = np.zeros(self._shapes[0]), self._lowest, self._highest
        self._solver = make_solver(self._cost, self._constraints, vectors, self._settings)

    def reset(self) -> None:
        """Forget the last answer, so that later answers do not depend on earlier calls."""
        self._solver.warm_start(*self._start)

    def solve(self, linear: Vector, lower: Vector, upper: Vector) -> Solution:
        """Solve for the vectors q of shape (n,) and l, u of shape (m,).

        Raises:
            SolverError: an array has another shape, is not float64 or not contiguous.
        """
        self._check(linear, lower, upper)
        low, high = self._limits
        # OSQP's infinity is 1e30: with IEEE's in its place it does not converge.
        np.maximum(lower, self._lowest, out=low)
        np.minimum(upper, self._highest, out=high)
        # No comparison holds with a NaN, so one that holds everywhere settles both.
        if not (_all(low <= high) and _all(np.isfinite(linear))):
            return Solution(_objection(linear, low, high))
        if self._solver.update_data_vec(linear, low, high) or self._solver.solve():
            return self._fail(QpStatus.OTHER)
        return self._answer()

    def _check(self, linear: Vector, lower: Vector, upper: Vector) -> None:
        """Check all arrays at once in the good case; one by one only to name the wrong one."""
        if (
            (linear.shape, lower.shape, upper.shape) == self._shapes
            and linear.dtype == lower.dtype == upper.dtype == np.float64
            and linear.flags.c_contiguous
            and lower.flags.c_contiguous
            and upper.flags.c_contiguous
        ):
            return
        for array, shape in zip((linear, lower, upper), self._shapes, strict=True):
            _checked(array, shape)

    def _answer(self) -> Solution:
        info = self._solver.info
        status = STATUS.get(info.status_val, QpStatus.OTHER)
        x: Vector = self._solver.solution.x
        if status is QpStatus.SOLVED and not _all(np.isfinite(x)):
            status = QpStatus.NOT_FINITE
        if status is not QpStatus.SOLVED:
            return self._fail(status, info.iter, info.run_time)
        return Solution(status, x, info.iter, info.run_time)

    def _fail(self, status: QpStatus, iterations: int = 0, run_s: float = 0.0) -> Solution:
        """A failed run leaves an iterate from which a warm start may never recover."""
        self.reset()
        return Solution(status, None, iterations, run_s)


def _all(truths: NDArray[np.bool_]) -> bool:
    """Return `truths.all()` in a quarter of its time."""
    return int(np.count_nonzero(truths)) == truths.size


def _objection(linear: Vector, lower: Vector, upper: Vector) -> QpStatus:
    """Return the status of vectors that are not passed to the solver."""
    known = np.isfinite(linear).all() and not np.isnan(lower).any() and not np.isnan(upper).any()
    return QpStatus.INFEASIBLE if known else QpStatus.NOT_FINITE


def _checked(array: Matrix, shape: tuple[int, ...]) -> Matrix:
    if array.shape != shape or array.dtype != np.float64 or not array.flags.c_contiguous:
        raise SolverError(
            f"The solver takes contiguous float64 {shape}, not {array.dtype} {array.shape}.",
            "Convert it with np.ascontiguousarray(array, np.float64).",
        )
    return array
