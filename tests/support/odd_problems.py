"""Problems with nothing to learn, and what every method does on them."""

import numpy as np

from eigenfail import plugins
from eigenfail.functions import of_batch
from eigenfail.settings import read_settings
from eigenfail.values.episode import learner_seed
from eigenfail.values.learning import LearnerContext
from eigenfail_services.campaigns.rounds import Rounds, run_in_process
from eigenfail_workers.functions import FunctionEngine

STEPS = 4


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


def run_search(problem, method, episodes, seed=3030, **settings):
    """Run a campaign of a method on a problem: the learner as it ends, and all results."""
    plugin = plugins.load(plugins.METHODS, method)
    nothing = np.zeros((0, problem.steps, 2), np.float32)
    context = LearnerContext(learner_seed(seed), episodes, problem.steps, nothing)
    learner = plugin(context, read_settings(plugin.Settings, settings, "settings"))
    engine = FunctionEngine(problem.function, problem.steps)
    return learner, list(run_in_process(Rounds(learner, seed, episodes), engine))


def check_end(method, settings, name):
    """Check that a method ends in order on an odd problem."""
    answer, rate = ODD[name]
    _, results = run_search(Answering(answer), method, 100, **settings)
    assert 20 <= len(results) <= 100
    assert [result.index for result in results] == list(range(len(results)))
    assert [result.fault for result in results] == [None] * len(results)
    assert all(np.isfinite(result.noise.z).all() for result in results)
    if rate is not None:
        assert {result.is_failure for result in results} == {bool(rate)}
    else:
        assert sum(result.is_failure for result in results) > 0


def check_broken_episodes(method, settings):
    """Check that a method goes on where some episodes cannot be run."""

    def fragile(x):
        if x[0] > 1.0:
            raise FloatingPointError("too far")
        return 1.0 + x

    _, results = run_search(Answering(fragile), method, 100, **settings)
    failed = [result for result in results if result.fault is not None]
    assert failed
    assert {result.fault.kind for result in failed} == {"simulator"}
    assert all(np.isfinite(result.noise.z).all() for result in results)
