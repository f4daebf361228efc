"""Problems with nothing to learn: clear outcomes, finite noise, and an end."""

import numpy as np
import pytest

from eigenfail.functions import of_batch

STEPS = 4
QUICK = {
    "monte_carlo": {},
    "ast": {"hold": 2, "hidden": (8,), "batch_size": 8, "warm_up": 10, "gradient_steps": 1},
    "cem": {"batch": 10},
    "cma": {"hold": 2},
    "annealing": {"hold": 2},
    "optuna": {"hold": 2},
    "difs": {"first_steps": 20, "steps": 10, "width": 8, "round_size": 20},
    "subset": {"samples": 20, "runs": 1, "most_levels": 4},
}


class Answering:
    """Robustness as a function of the first step's noise, longitudinal."""

    steps = STEPS

    def __init__(self, answer):
        self.function = of_batch(lambda z: answer(z[:, 0, 0]))


ODD = {
    "all fail": (lambda x: np.full_like(x, -1.0), 1.0),
    "all fail just so": (np.zeros_like, 1.0),
    "none fails, all alike": (lambda x: np.full_like(x, 7.0), 0.0),
    "none fails, none alike": (lambda x: 100.0 + x, 0.0),
    "huge": (lambda x: 1e14 + 1e13 * x, 0.0),
    "tiny": (lambda x: 1e-30 * (2.0 + np.tanh(x)), 0.0),
    "a cliff": (lambda x: np.where(x > 0.0, 0.0, 1e6), None),
}


@pytest.mark.parametrize("name", ODD)
@pytest.mark.parametrize("method", QUICK)
def test_every_method_ends_in_order(method, name, search):
    answer, rate = ODD[name]
    _, results = search(Answering(answer), method, 100, **QUICK[method])
    assert 20 <= len(results) <= 100
    assert [result.index for result in results] == list(range(len(results)))
    assert [result.fault for result in results] == [None] * len(results)
    assert all(np.isfinite(result.noise.z).all() for result in results)
    if rate is not None:
        assert {result.is_failure for result in results} == {bool(rate)}
    else:
        assert sum(result.is_failure for result in results) > 0


@pytest.mark.parametrize("method", QUICK)
def test_episodes_that_cannot_be_run_do_not_stop_it(method, search):
    def fragile(x):
        if x[0] > 1.0:
            raise FloatingPointError("too far")
        return 1.0 + x

    _, results = search(Answering(fragile), method, 100, **QUICK[method])
    failed = [result for result in results if result.fault is not None]
    assert failed
    assert {result.fault.kind for result in failed} == {"simulator"}
    assert all(np.isfinite(result.noise.z).all() for result in results)
