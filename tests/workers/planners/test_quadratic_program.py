"""The program against closed forms and its optimality conditions; everything that can go wrong."""

from types import SimpleNamespace

import numpy as np
import pytest

from eigenfail.errors import SolverError
from eigenfail_workers.planners.rulebook.quadratic_program import (
    QpStatus,
    QuadraticProgram,
    SolverSettings,
)

TIGHT = SolverSettings(tolerance=1e-8, max_iterations=20_000)


def box(settings=TIGHT):
    """min ½|x|² + qᵀx in a box: x = clip(-q)."""
    return QuadraticProgram(np.eye(3), np.eye(3), settings)


def test_a_box_has_a_closed_form():
    q, bound = np.array([0.3, -5.0, 2.0]), np.ones(3)
    solution = box().solve(q, -bound, bound)
    assert solution.status is QpStatus.SOLVED
    assert solution.x == pytest.approx(np.clip(-q, -1, 1), abs=1e-6)


def test_an_equality_has_a_closed_form():
    """min ½xᵀPx + qᵀx with one equality, by the linear system of its Lagrangian."""
    rng = np.random.default_rng(3)
    root = rng.normal(size=(4, 4))
    cost, row, q = root @ root.T + np.eye(4), rng.normal(size=(1, 4)), rng.normal(size=4)
    system = np.block([[cost, row.T], [row, np.zeros((1, 1))]])
    expected = np.linalg.solve(system, np.concatenate([-q, [2.0]]))[:4]
    solution = QuadraticProgram(cost, row, TIGHT).solve(q, np.array([2.0]), np.array([2.0]))
    assert solution.x == pytest.approx(expected, abs=1e-5)


def test_random_programs_cannot_be_improved_upon_within_their_limits():
    """Variational inequality of a convex optimum: grad · (y - x) >= 0 for every feasible y."""
    rng = np.random.default_rng(4)
    for _ in range(10):
        root = rng.normal(size=(3, 3))
        cost, q = root @ root.T + 0.1 * np.eye(3), rng.normal(size=3)
        low, high = -rng.uniform(0, 1, 3), rng.uniform(0, 1, 3)
        x = QuadraticProgram(cost, np.eye(3), TIGHT).solve(q, low, high).x
        assert x is not None
        assert np.all(x >= low - 1e-6)
        assert np.all(x <= high + 1e-6)
        feasible = rng.uniform(low, high, (200, 3))
        assert np.min((feasible - x) @ (cost @ x + q)) > -1e-4


def test_a_warm_start_needs_fewer_iterations_and_a_reset_none_of_it():
    program, q, bound = box(), np.array([0.3, -5.0, 2.0]), np.ones(3)
    first = program.solve(q, -bound, bound)
    again = program.solve(q, -bound, bound)
    program.solve(-3.0 * q, -bound, bound)
    program.reset()
    after = program.solve(q, -bound, bound)
    assert again.iterations < first.iterations
    assert after.iterations == first.iterations
    assert after.x.tobytes() == first.x.tobytes()


@pytest.mark.parametrize("place", [0, 1, 2])
def test_nan_is_refused_and_does_not_poison_what_follows(place):
    program, vectors = box(), [np.zeros(3), -np.ones(3), np.ones(3)]
    poisoned = [v.copy() for v in vectors]
    poisoned[place][1] = np.nan
    assert program.solve(*poisoned).status is QpStatus.NOT_FINITE
    assert program.solve(*vectors).status is QpStatus.SOLVED


def test_an_answer_of_nan_is_not_taken_for_solved(monkeypatch):
    program, bound = box(), np.ones(3)
    program.solve(np.zeros(3), -bound, bound)
    info = SimpleNamespace(status="solved", iter=1, run_time=0.0)
    lying = SimpleNamespace(
        update=lambda **_: None,
        solve=lambda **_: SimpleNamespace(x=np.full(3, np.nan), info=info),
    )
    monkeypatch.setattr(program, "_solver", lying)
    answer = program.solve(np.zeros(3), -bound, bound)
    assert (answer.status, answer.x) == (QpStatus.NOT_FINITE, None)
    assert program.solve(np.zeros(3), -bound, bound).status is QpStatus.SOLVED


def test_infeasible_limits_are_told():
    crossed = box().solve(np.zeros(3), np.ones(3), -np.ones(3))
    assert crossed.status is QpStatus.INFEASIBLE
    rows = np.array([[1.0], [1.0]])
    apart = QuadraticProgram(np.eye(1), rows, TIGHT)
    bounds = np.array([1.0, -2.0]), np.array([2.0, -1.0])
    assert apart.solve(np.zeros(1), *bounds).status is QpStatus.INFEASIBLE


def test_the_iteration_limit_is_told():
    hasty = SolverSettings(tolerance=1e-9, max_iterations=1, check_every=1)
    answer = box(hasty).solve(np.array([0.3, -5.0, 2.0]), -np.ones(3), np.ones(3))
    assert (answer.status, answer.x) == (QpStatus.ITERATION_LIMIT, None)


@pytest.mark.parametrize(
    "wrong", [np.zeros(4), np.zeros(3, np.float32), np.zeros(6)[::2], np.zeros((3, 1))]
)
def test_wrong_shape_type_or_layout_never_reaches_the_solver(wrong):
    with pytest.raises(SolverError, match="float64"):
        box().solve(wrong, -np.ones(3), np.ones(3))


def test_matrices_that_do_not_fit_are_refused():
    with pytest.raises(SolverError, match="fit"):
        QuadraticProgram(np.eye(2), np.eye(3), TIGHT)
