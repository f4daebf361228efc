"""Problems with nothing to learn: clear outcomes, finite noise, and an end."""

import pytest
from odd_problems import ODD, check_broken_episodes, check_end

QUICK = {
    "monte_carlo": {},
    "ast": {"hold": 2, "hidden": (8,), "batch_size": 8, "warm_up": 10, "gradient_steps": 1},
    "cem": {"batch": 10},
    "cma": {"hold": 2},
    "difs": {"first_steps": 20, "steps": 10, "width": 8, "round_size": 20},
    "subset": {"samples": 20, "runs": 1, "most_levels": 4},
}


@pytest.mark.parametrize("name", ODD)
@pytest.mark.parametrize("method", QUICK)
def test_every_method_ends_in_order(method, name):
    check_end(method, QUICK[method], name)


@pytest.mark.parametrize("method", QUICK)
def test_episodes_that_cannot_be_run_do_not_stop_it(method):
    check_broken_episodes(method, QUICK[method])
