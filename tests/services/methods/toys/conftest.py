"""Whole campaigns on toy problems, in this process."""

import sys
from pathlib import Path

import numpy as np
import pytest

from eigenfail import plugins
from eigenfail.settings import read_settings
from eigenfail.values import LearnerContext, learner_seed
from eigenfail_services.campaigns.rounds import Rounds, run_in_process
from eigenfail_workers.functions import FunctionEngine

sys.path.append(str(Path(__file__).parent))


@pytest.fixture
def search():
    """Run a campaign of a method on a problem: the learner as it ends, and all results."""

    def run(problem, method, episodes, seed=3030, **settings):
        plugin = plugins.load(plugins.METHODS, method)
        nothing = np.zeros((0, problem.steps, 2), np.float32)
        context = LearnerContext(learner_seed(seed), episodes, problem.steps, nothing)
        learner = plugin(context, read_settings(plugin.Settings, settings, "settings"))
        engine = FunctionEngine(problem.function, problem.steps)
        return learner, list(run_in_process(Rounds(learner, seed, episodes), engine))

    return run
