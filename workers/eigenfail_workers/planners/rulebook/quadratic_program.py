"""A quadratic program on OSQP that is asked again and again with new vectors.

min ½ xᵀPx + qᵀx subject to l ≤ Ax ≤ u, with P and A fixed. OSQP checks neither sizes nor types and
can say "solved" over a NaN, so both sides are checked here. Nothing in it depends on the clock:
rho stays as set, and only the number of iterations is bounded.
"""

from enum import StrEnum
from typing import Annotated, Any

import msgspec
import numpy as np
import osqp
from msgspec import Meta
from numpy.typing import NDArray
from scipy import sparse

from eigenfail.errors import SolverError

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]


class SolverSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """How OSQP works; see its own documentation.

    Attributes:
        max_iterations: bound of the work; the only one.
        check_every: iterations between two tests for convergence.
        tolerance: absolute and relative.
        rho: step size of the method, fixed.
    """

    max_iterations: Annotated[int, Meta(ge=1, le=100_000)] = 1000
    check_every: Annotated[int, Meta(ge=1, le=1000)] = 10
    tolerance: Annotated[float, Meta(gt=0.0, le=0.1)] = 1e-3
    rho: Annotated[float, Meta(gt=0.0, le=1e6)] = 0.1


class QpStatus(StrEnum):
    """What came of a call. Only `solved` comes with an answer."""

    SOLVED = "solved"
    ITERATION_LIMIT = "iteration_limit"
    INFEASIBLE = "infeasible"
    NOT_FINITE = "not_finite"
    OTHER = "other"


STATUS = {
    "solved": QpStatus.SOLVED,
    "solved inaccurate": QpStatus.ITERATION_LIMIT,
    "maximum iterations reached": QpStatus.ITERATION_LIMIT,
    "primal infeasible": QpStatus.INFEASIBLE,
    "primal infeasible inaccurate": QpStatus.INFEASIBLE,
    "dual infeasible": QpStatus.INFEASIBLE,
    "dual infeasible inaccurate": QpStatus.INFEASIBLE,
}
"""OSQP's words, in ours."""


class Solution(msgspec.Struct, frozen=True, eq=False):
    """An answer of shape (variables,), or None and why not.

    Attributes:
        run_s: time that OSQP itself reports.
    """

    status: QpStatus
    x: Vector | None = None
    iterations: int = 0
    run_s: float = 0.0


class QuadraticProgram:
    """One problem structure, warm-started from call to call until `reset`."""

    def __init__(self, cost: Matrix, constraints: Matrix, settings: SolverSettings) -> None:
        """cost: P of shape (n, n), symmetric; constraints: A of shape (m, n)."""
        if cost.shape != (constraints.shape[1],) * 2:
            raise SolverError(f"P is {cost.shape} and A {constraints.shape}.", "Make them fit.")
        self._cost = sparse.csc_matrix(np.triu(_checked(cost, cost.shape)))
        self._constraints = sparse.csc_matrix(_checked(constraints, constraints.shape))
        self._settings = settings
        self._solver: Any = None

    def reset(self) -> None:
        """Forget the last answer: what follows depends on nothing that was asked before."""
        self._solver = None

    def solve(self, linear: Vector, lower: Vector, upper: Vector) -> Solution:
        """Solve for the vectors q of shape (n,) and l, u of shape (m,).

        Raises:
            SolverError: an array has another shape, is not float64 or not contiguous.
        """
        rows, columns = self._constraints.shape
        _checked(linear, (columns,)), _checked(lower, (rows,)), _checked(upper, (rows,))
        if not np.isfinite(linear).all() or np.isnan(lower).any() or np.isnan(upper).any():
            return Solution(QpStatus.NOT_FINITE)
        if (lower > upper).any():
            return Solution(QpStatus.INFEASIBLE)
        self._load(linear, lower, upper)
        return self._run()

    def _load(self, linear: Vector, lower: Vector, upper: Vector) -> None:
        if self._solver is None:
            self._solver = self._set_up(linear, lower, upper)
        else:
            self._solver.update(q=linear, l=lower, u=upper)

    def _set_up(self, linear: Vector, lower: Vector, upper: Vector) -> Any:
        solver = osqp.OSQP(algebra="builtin")
        settings = self._settings
        solver.setup(
            self._cost,
            linear,
            self._constraints,
            lower,
            upper,
            verbose=False,
            warm_starting=True,
            polishing=False,
            adaptive_rho=0,
            rho=settings.rho,
            max_iter=settings.max_iterations,
            check_termination=settings.check_every,
            eps_abs=settings.tolerance,
            eps_rel=settings.tolerance,
        )
        return solver

    def _run(self) -> Solution:
        result = self._solver.solve(raise_error=False)
        info = result.info
        status = STATUS.get(info.status, QpStatus.OTHER)
        x = np.array(result.x, np.float64)
        if status is QpStatus.SOLVED and not np.isfinite(x).all():
            status = QpStatus.NOT_FINITE
        if status is not QpStatus.SOLVED:
            # A failed run leaves an iterate from which a warm start may never recover.
            self.reset()
            return Solution(status, None, info.iter, info.run_time)
        return Solution(status, x, info.iter, info.run_time)


def _checked(array: Matrix, shape: tuple[int, ...]) -> Matrix:
    if array.shape != shape or array.dtype != np.float64 or not array.flags.c_contiguous:
        raise SolverError(
            f"The solver takes contiguous float64 {shape}, not {array.dtype} {array.shape}.",
            "Convert it with np.ascontiguousarray(array, np.float64).",
        )
    return array
