"""The program against closed forms and its optimality conditions; everything that can go wrong."""

from types import SimpleNamespace

import numpy as np
import osqp
import pytest
from scipy import sparse

from eigenfail.errors import SolverError
from eigenfail_workers.planners.rulebook.quadratic_program import (
    OPEN,
    QuadraticProgram,
    make_solver_options,
)
from eigenfail_workers.planners.rulebook.settings import SolverSettings
from eigenfail_workers.planners.rulebook.values import QpStatus

TIGHT = SolverSettings(tolerance=1e-8, max_iterations=20_000)


def box(settings=TIGHT):
    """min ½|x|² + qᵀx in a box: x = clip(-q)."""
    return QuadraticProgram(np.eye(3), np.eye(3), settings)


def solve(program, q, low, high):
    """The answer for these vectors, in which an infinite side is an open one."""
    program.linear[:] = q
    program.lower[:] = np.maximum(low, -OPEN)
    program.upper[:] = np.minimum(high, OPEN)
    return program.solve()


def test_a_box_has_a_closed_form():
    q, bound = np.array([0.3, -5.0, 2.0]), np.ones(3)
    solution = solve(box(), q, -bound, bound)
    assert solution.status is QpStatus.SOLVED
    assert solution.x == pytest.approx(np.clip(-q, -1, 1), abs=1e-6)


def test_an_equality_has_a_closed_form():
    """min ½xᵀPx + qᵀx with one equality, by the linear system of its Lagrangian."""
    rng = np.random.default_rng(3)
    root = rng.normal(size=(4, 4))
    cost, row, q = root @ root.T + np.eye(4), rng.normal(size=(1, 4)), rng.normal(size=4)
    system = np.block([[cost, row.T], [row, np.zeros((1, 1))]])
    expected = np.linalg.solve(system, np.concatenate([-q, [2.0]]))[:4]
    solution = solve(QuadraticProgram(cost, row, TIGHT), q, np.array([2.0]), np.array([2.0]))
    assert solution.x == pytest.approx(expected, abs=1e-5)


def test_random_programs_cannot_be_improved_upon_within_their_limits():
    """Variational inequality of a convex optimum: grad · (y - x) >= 0 for every feasible y."""
    rng = np.random.default_rng(4)
    for _ in range(10):
        root = rng.normal(size=(3, 3))
        cost, q = root @ root.T + 0.1 * np.eye(3), rng.normal(size=3)
        low, high = -rng.uniform(0, 1, 3), rng.uniform(0, 1, 3)
        x = solve(QuadraticProgram(cost, np.eye(3), TIGHT), q, low, high).x
        assert x is not None
        assert np.all(x >= low - 1e-6)
        assert np.all(x <= high + 1e-6)
        feasible = rng.uniform(low, high, (200, 3))
        assert np.min((feasible - x) @ (cost @ x + q)) > -1e-4


def test_a_warm_start_needs_fewer_iterations_and_a_reset_none_of_it():
    program, q, bound = box(), np.array([0.3, -5.0, 2.0]), np.ones(3)
    first, iterations = solve(program, q, -bound, bound), program._report.iter
    solve(program, q, -bound, bound)
    assert program._report.iter < iterations
    solve(program, -3.0 * q, -bound, bound)
    program.reset()
    after = solve(program, q, -bound, bound)
    assert program._report.iter == iterations
    assert after.x.tobytes() == first.x.tobytes()


@pytest.mark.fault("quadratic program that is infeasible or contains NaN")
@pytest.mark.parametrize("place", [0, 1, 2])
def test_nan_is_refused_and_does_not_poison_what_follows(place):
    program, vectors = box(), [np.zeros(3), -np.ones(3), np.ones(3)]
    poisoned = [v.copy() for v in vectors]
    poisoned[place][1] = np.nan
    assert solve(program, *poisoned).status is QpStatus.NOT_FINITE
    assert solve(program, *vectors).status is QpStatus.SOLVED


@pytest.mark.fault("quadratic program that is infeasible or contains NaN")
def test_a_run_into_nan_is_told_and_not_remembered():
    """A cost that is finite and whose square is not: OSQP's own iterate becomes NaN."""
    program, q, bound = box(), np.array([0.3, -5.0, 2.0]), np.ones(3)
    first = solve(program, q, -bound, bound)
    lost = solve(program, np.full(3, 1e308), -bound, bound)
    assert (lost.status, lost.x) == (QpStatus.ITERATION_LIMIT, None)
    assert solve(program, q, -bound, bound).x.tobytes() == first.x.tobytes()


@pytest.mark.fault("quadratic program that is infeasible or contains NaN")
def test_an_answer_of_nan_is_not_taken_for_solved(monkeypatch):
    program, bound = box(), np.ones(3)
    lying = SimpleNamespace(
        update_data_vec=lambda *_: 0,
        solve=lambda: 0,
        warm_start=lambda *_: 0,
        info=SimpleNamespace(status_val=osqp.SolverStatus.OSQP_SOLVED, iter=1, run_time=0.0),
        solution=SimpleNamespace(x=np.full(3, np.nan)),
    )
    monkeypatch.setattr(program, "_solver", lying)
    monkeypatch.setattr(program, "_report", lying.info)
    answer = solve(program, np.zeros(3), -bound, bound)
    assert (answer.status, answer.x) == (QpStatus.NOT_FINITE, None)


def test_an_answer_is_the_callers_to_keep():
    program, bound = box(), np.ones(3)
    first = solve(program, -bound, -bound, bound).x
    kept = first.copy()
    solve(program, bound, -bound, bound)
    assert first.tobytes() == kept.tobytes()


def random_programs(n, seed=8, size=4):
    """q, l, u of programs with an open side here and there."""
    rng = np.random.default_rng(seed)
    for _ in range(n):
        low, high = -rng.uniform(0, 1, size), rng.uniform(0, 1, size)
        low[rng.random(size) < 0.3], high[rng.random(size) < 0.3] = -np.inf, np.inf
        yield rng.normal(size=size), low, high


def test_the_inner_solver_gives_the_bits_of_the_public_one():
    cost, rows = np.diag([1.0, 2.0, 3.0, 4.0]), np.eye(4) + 0.1
    settings = SolverSettings()
    program = QuadraticProgram(cost, rows, settings)
    public = osqp.OSQP(algebra="builtin")
    matrices = sparse.csc_matrix(cost), np.zeros(4), sparse.csc_matrix(rows)
    far = np.full(4, 1e30)
    public.setup(*matrices, -far, far, **make_solver_options(settings))
    assert isinstance(public._solver, public.ext.OSQPSolver)
    for q, low, high in random_programs(30):
        public.update(q=q, l=low, u=high)
        theirs, ours = public.solve(raise_error=False), solve(program, q, low, high)
        assert ours.status is QpStatus.SOLVED
        assert ours.x.tobytes() == theirs.x.tobytes()
        assert program._report.iter == theirs.info.iter


def test_a_reset_is_worth_a_new_set_up():
    program = QuadraticProgram(np.eye(4), np.eye(4) + 0.1, SolverSettings())
    asked = list(random_programs(10))
    asked.append((np.zeros(4), np.full(4, 0.2), np.full(4, 0.2)))
    first = [solve(program, *vectors).x.tobytes() for vectors in asked]
    program.reset()
    assert [solve(program, *vectors).x.tobytes() for vectors in asked] == first
    program.set_up()
    assert [solve(program, *vectors).x.tobytes() for vectors in asked] == first


def test_infinite_limits_are_no_limits():
    free = solve(box(), np.array([3.0, -4.0, 0.0]), np.full(3, -np.inf), np.full(3, np.inf))
    assert free.x == pytest.approx([-3.0, 4.0, 0.0], abs=1e-6)


@pytest.mark.fault("quadratic program that is infeasible or contains NaN")
@pytest.mark.parametrize("wall", [np.inf, -np.inf])
def test_limits_that_leave_no_number_are_infeasible(wall):
    limits = np.full(3, wall)
    assert solve(box(), np.zeros(3), limits, limits).status is QpStatus.INFEASIBLE


@pytest.mark.fault("quadratic program that is infeasible or contains NaN")
def test_an_infinite_cost_is_not_finite():
    q = np.array([0.0, np.inf, 0.0])
    assert solve(box(), q, -np.ones(3), np.ones(3)).status is QpStatus.NOT_FINITE


@pytest.mark.fault(
    "quadratic program that is infeasible or contains NaN",
    group="plug-ins",
    outcome="The solver reports which of them it is, and the planner uses its fallback.",
)
def test_infeasible_limits_are_told():
    crossed = solve(box(), np.zeros(3), np.ones(3), -np.ones(3))
    assert crossed.status is QpStatus.INFEASIBLE
    rows = np.array([[1.0], [1.0]])
    apart = QuadraticProgram(np.eye(1), rows, TIGHT)
    bounds = np.array([1.0, -2.0]), np.array([2.0, -1.0])
    assert solve(apart, np.zeros(1), *bounds).status is QpStatus.INFEASIBLE


@pytest.mark.fault(
    "quadratic program that does not converge",
    group="time",
    outcome="The solver stops at its iteration limit, and the planner uses its fallback.",
)
def test_the_iteration_limit_is_told():
    hasty = SolverSettings(tolerance=1e-9, max_iterations=1, check_every=1)
    answer = solve(box(hasty), np.array([0.3, -5.0, 2.0]), -np.ones(3), np.ones(3))
    assert (answer.status, answer.x) == (QpStatus.ITERATION_LIMIT, None)


@pytest.mark.fault("quadratic program that is infeasible or contains NaN")
def test_a_cost_that_falls_forever_is_refused():
    with pytest.raises(SolverError, match="positive semidefinite"):
        QuadraticProgram(-np.eye(3), np.eye(3), TIGHT)


def test_matrices_that_do_not_fit_are_refused():
    with pytest.raises(SolverError, match="fit"):
        QuadraticProgram(np.eye(2), np.eye(3), TIGHT)
