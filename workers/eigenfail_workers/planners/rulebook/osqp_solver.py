"""OSQP: its settings, and its solver without the wrapping that costs more than the solving."""

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
    """How OSQP works; see its own documentation.

    Attributes:
        max_iterations: bound of the work; the only one.
        check_every: iterations between two tests for convergence.
        tolerance: absolute and relative.
        rho: step size of the method, fixed.
    """

    max_iterations: Annotated[int, Meta(ge=1, le=100_000)] = 1000
    check_every: Annotated[int, Meta(ge=1, le=1000)] = 5
    tolerance: Annotated[float, Meta(gt=0.0, le=0.1)] = 1e-4
    rho: Annotated[float, Meta(gt=0.0, le=1e6)] = 0.1


def solver_options(settings: SolverSettings) -> dict[str, float]:
    """The settings under OSQP's names, and what of its own must not depend on the clock."""
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


def new_solver(
    cost: sparse.csc_matrix,
    constraints: sparse.csc_matrix,
    vectors: Vectors,
    settings: SolverSettings,
) -> Any:
    """The extension's own solver object, set up for P (its upper triangle), A and (q, l, u).

    The public `solve()` copies every field of its report into a namespace, which takes longer than
    OSQP takes to solve; the object behind it does not. It is private, so only releases 1.1 are
    taken, and a test holds its answers equal to the public ones.

    Raises:
        SolverError: P is not positive semidefinite.
    """
    public = osqp.OSQP(algebra="builtin")
    linear, lower, upper = vectors
    try:
        public.setup(cost, linear, constraints, lower, upper, **solver_options(settings))
    except osqp.OSQPException as refusal:
        message = f"OSQP refuses the program, with its error {refusal.args}."
        raise SolverError(message, "Make P positive semidefinite.") from refusal
    return public._solver  # noqa: SLF001
