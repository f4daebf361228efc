"""OSQP: its settings, and its solver without a wrapper that costs more time than solving."""

from typing import Annotated, Any

import msgspec
import numpy as np
import osqp
from msgspec import Meta
from numpy.typing import NDArray
from scipy import sparse

from eigenfail.errors import SolverError

Vectors = tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]


class SolverSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Settings of OSQP; see its documentation.

    Attributes:
        max_iterations: the only bound, as wall time would make answers irreproducible.
        check_every: iterations between two tests for convergence.
        tolerance: absolute and relative.
        rho: step size of the method, fixed.
    """

    max_iterations: Annotated[int, Meta(ge=1, le=100_000)] = 1000
    check_every: Annotated[int, Meta(ge=1, le=1000)] = 5
    tolerance: Annotated[float, Meta(gt=0.0, le=0.1)] = 1e-4
    rho: Annotated[float, Meta(gt=0.0, le=1e6)] = 0.1


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
