"""The shipped suite of learners, over all methods."""

from types import MappingProxyType

import numpy as np

from eigenfail.testing.learner import LearnerSuite
from eigenfail.values.learning import LearnerContext
from eigenfail_services.methods.ast.method import AdaptiveStressTesting
from eigenfail_services.methods.cem import CrossEntropyMethod
from eigenfail_services.methods.cma import CovarianceAdaptation
from eigenfail_services.methods.difs.method import DiffusionFailureSampling
from eigenfail_services.methods.held import HeldNoise
from eigenfail_services.methods.minimal import Minimal
from eigenfail_services.methods.mixture import MixtureMethod
from eigenfail_services.methods.monte_carlo import MonteCarlo
from eigenfail_services.methods.nearest import NearestFailingPoint
from eigenfail_services.methods.replay import Replay
from eigenfail_services.methods.splitting import MultilevelSplitting
from eigenfail_services.methods.subset import SubsetMethod


def draw_noise(seed, count, corridor, mean, deviation):
    shape = count, corridor.steps, corridor.channels
    return np.random.default_rng(seed).normal(mean, deviation, shape).astype(np.float32)


class TestMonteCarlo(LearnerSuite):
    method = MonteCarlo
    settings = MappingProxyType({"round_size": 6})


class TestHeldNoise(LearnerSuite):
    method = HeldNoise
    settings = MappingProxyType({"hold": 3, "round_size": 6})


class TestCovarianceAdaptation(LearnerSuite):
    method = CovarianceAdaptation
    settings = MappingProxyType({"hold": 7, "runs": 2, "population": 5})


class TestSubsetSimulation(LearnerSuite):
    method = SubsetMethod
    settings = MappingProxyType({"samples": 20, "round_size": 6})
    budget = 60


class TestSubsetSimulationInParallel(LearnerSuite):
    method = SubsetMethod
    settings = MappingProxyType({"samples": 20, "level_share": 0.5})
    budget = 160
    rounds = 8

    def context(self, seed, corridor):
        nothing = np.zeros((0, corridor.steps, corridor.channels), np.float32)
        return LearnerContext(seed, self.budget, corridor.steps, nothing, parallel=8)


class TestMultilevelSplitting(LearnerSuite):
    method = MultilevelSplitting
    settings = MappingProxyType({"runs": 5, "particles": 20, "round_size": 33})
    budget = 400


class TestMixtureSampling(LearnerSuite):
    method = MixtureMethod
    settings = MappingProxyType({"round_size": 60})
    budget = 500


class TestReplay(LearnerSuite):
    method = Replay
    settings = MappingProxyType({"round_size": 6, "repeats": 2})
    budget = 60


class TestMinimal(LearnerSuite):
    method = Minimal
    settings = MappingProxyType({"round_size": 2})

    def context(self, seed, corridor):
        noise = draw_noise(seed, 1, corridor, 1.5, 1.0)
        return LearnerContext(seed, self.budget, corridor.steps, noise)


class TestNearestFailingPoint(LearnerSuite):
    method = NearestFailingPoint
    settings = MappingProxyType({"analysis": 1})

    def context(self, seed, corridor):
        noise = draw_noise(seed, 4, corridor, 0.2, 0.1)
        noise[2:] += 2.0
        return LearnerContext(seed, self.budget, corridor.steps, noise)


class TestAdaptiveStressTesting(LearnerSuite):
    method = AdaptiveStressTesting
    settings = MappingProxyType(
        {"round_size": 4, "warm_up": 4, "buffer_size": 70, "gradient_steps": 2}
    )


class TestAdaptiveStressTestingInParallel(LearnerSuite):
    method = AdaptiveStressTesting
    settings = MappingProxyType({"round_size": 4, "warm_up": 4, "gradient_steps": 1})

    def context(self, seed, corridor):
        nothing = np.zeros((0, corridor.steps, corridor.channels), np.float32)
        return LearnerContext(seed, self.budget, corridor.steps, nothing, parallel=8)


class TestAdaptiveStressTestingByStableBaselines(LearnerSuite):
    method = AdaptiveStressTesting
    settings = MappingProxyType(
        {"round_size": 4, "warm_up": 4, "buffer_size": 70, "trainer": "sb3", "gradient_steps": 1}
    )


class TestCrossEntropyMethod(LearnerSuite):
    method = CrossEntropyMethod
    settings = MappingProxyType({"batch": 7, "elite_share": 0.3})


class TestDiffusionFailureSampling(LearnerSuite):
    method = DiffusionFailureSampling
    settings = MappingProxyType(
        {"round_size": 5, "first_steps": 20, "steps": 10, "memory": 12, "device": "cpu"}
    )
