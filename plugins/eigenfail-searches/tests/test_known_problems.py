"""`cma` on problems whose failures are known: their probability, and the likeliest of them."""

import numpy as np
import pytest
from odd_problems import run_search
from problems import HalfSpace, PointMassCorridor, TwoModes, cosine, steady, turning

PROBABILITIES = (1e-3, 1e-6)


def list_failures(results):
    return [result for result in results if result.is_failure]


def compute_failure_rate(results):
    return len(list_failures(results)) / len(results)


def compute_left_share(results):
    """Share of the failures on the left."""
    return np.mean([result.noise.z[0, 0] < 0.0 for result in list_failures(results)])


def test_it_fails_thousands_of_times_as_often_as_the_prior():
    _, results = run_search(TwoModes(), "cma", 400)
    assert compute_failure_rate(results) >= 3000 * TwoModes.probability


def test_it_drives_a_point_mass_into_a_wall():
    problem = PointMassCorridor()
    _, results = run_search(problem, "cma", 400, hold=4)
    assert compute_failure_rate(results) >= 30 * problem.at_most


def test_the_runs_of_cma_reach_both_corners_and_get_near_the_likeliest_failures():
    both = 0
    for seed in range(3040, 3044):
        _, results = run_search(TwoModes(), "cma", 1000, seed)
        assert compute_failure_rate(results) >= 0.3
        both += 0.05 < compute_left_share(results) < 0.95
        found = np.array([one.noise.z[0] for one in results if one.is_failure])
        nearest = [np.linalg.norm(found - corner, axis=1).min() for corner in TwoModes.corners]
        assert min(nearest) < 0.2
    assert both >= 3


@pytest.mark.parametrize("direction", [steady, turning])
@pytest.mark.parametrize("probability", PROBABILITIES)
def test_cma_fails_in_half_of_its_episodes_and_comes_near_the_likeliest_failure(
    probability, direction
):
    problem = HalfSpace(probability, direction(20))
    _, results = run_search(problem, "cma", 1000, hold=5)
    assert compute_failure_rate(results) >= 0.5
    noise = [result.noise.z for result in list_failures(results)]
    likeliest = min(noise, key=np.linalg.norm)
    assert np.linalg.norm(likeliest) <= 1.25 * problem.beta
    assert cosine(likeliest, problem.direction) >= 0.85
