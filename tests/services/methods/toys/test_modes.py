"""Problems with two ways to fail: the corners of Delecki et al. 2025, and a corridor's walls."""

import numpy as np
import pytest
from odd_problems import run_search
from problems import SMALL_AST, PointMassCorridor, TwoModes

ON_CORNERS = {
    "ast": (200, {**SMALL_AST, "hold": 1, "amplitude": 4.0}),
    "cem": (400, {"max_mean": 4.0}),
}
IN_CORRIDOR = {
    "ast": (100, {**SMALL_AST, "hold": 4}),
    "cma": (400, {"hold": 4}),
    "cem": (400, {}),
    "difs": (500, {"first_steps": 200, "steps": 100, "width": 32}),
}


def failure_rate(results):
    return sum(result.is_failure for result in results) / len(results)


def sides(results):
    """Share of the failures on the left."""
    return np.mean([result.noise.z[0, 0] < 0.0 for result in results if result.is_failure])


@pytest.mark.parametrize("method", ON_CORNERS)
def test_it_fails_thousands_of_times_as_often_as_the_prior(method):
    problem = TwoModes()
    assert problem.probability == pytest.approx(3.65e-6, rel=0.01)
    episodes, settings = ON_CORNERS[method]
    _, results = run_search(problem, method, episodes, **settings)
    assert failure_rate(results) >= 3000 * problem.probability


def test_subset_sees_both_corners_and_tells_their_probability():
    problem = TwoModes()
    held = 0
    for seed in range(3040, 3044):
        learner, results = run_search(problem, "subset", 12_000, seed)
        found = learner.estimate().interval
        held += found is not None and found.low < problem.probability < found.high
        assert 0.1 < sides(results) < 0.9
    # Two of four intervals of 95 % miss by chance once in 70 tests.
    assert held >= 3


def test_difs_sees_both_corners():
    """With each of the seeds 3030 to 3035 a tenth of its failures or more lie in each corner."""
    given = {"first_steps": 100, "steps": 60, "width": 24}
    _, results = run_search(TwoModes(), "difs", 1000, 3032, **given)
    assert failure_rate(results) >= 10_000 * TwoModes.probability
    assert 0.2 < sides(results) < 0.8


def test_the_runs_of_cma_reach_both_corners_and_get_near_the_likeliest_failures():
    both = 0
    for seed in range(3040, 3044):
        _, results = run_search(TwoModes(), "cma", 1000, seed)
        assert failure_rate(results) >= 0.3
        both += 0.05 < sides(results) < 0.95
        found = np.array([one.noise.z[0] for one in results if one.is_failure])
        nearest = [np.linalg.norm(found - corner, axis=1).min() for corner in TwoModes.corners]
        assert min(nearest) < 0.2
    assert both >= 3


def test_the_corridor_is_as_rare_as_its_bounds_say():
    problem, random = PointMassCorridor(beta=2.5), np.random.default_rng(3030)
    failed = problem.robustness(random.standard_normal((20_000, problem.steps, 2))) <= 0.0
    slack = 4 * (problem.at_most / 20_000) ** 0.5
    assert problem.at_least - slack < failed.mean() < problem.at_most + slack


@pytest.mark.parametrize("method", IN_CORRIDOR)
def test_every_method_drives_a_point_mass_into_a_wall(method):
    problem = PointMassCorridor()
    assert problem.at_most < 1e-3
    episodes, settings = IN_CORRIDOR[method]
    _, results = run_search(problem, method, episodes, **settings)
    assert failure_rate(results) >= 30 * problem.at_most


def test_subset_tells_a_probability_between_the_corridors_bounds():
    problem = PointMassCorridor()
    learner, results = run_search(problem, "subset", 4000)
    assert failure_rate(results) >= 30 * problem.at_most
    found = learner.estimate()
    assert found.interval.high > problem.at_least
    assert found.interval.low < problem.at_most
