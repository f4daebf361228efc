"""The shipped suite of learners, over all methods."""

from types import MappingProxyType

from eigenfail.testing.learner import LearnerSuite
from eigenfail_services.methods.ast.method import AdaptiveStressTesting
from eigenfail_services.methods.cem.method import CrossEntropyMethod
from eigenfail_services.methods.difs.method import DiffusionFailureSampling
from eigenfail_services.methods.monte_carlo import MonteCarlo
from eigenfail_services.methods.replay import Replay
from eigenfail_services.methods.subset.method import SubsetMethod


class TestMonteCarlo(LearnerSuite):
    method = MonteCarlo
    settings = MappingProxyType({"round_size": 6})


class TestSubsetSimulation(LearnerSuite):
    method = SubsetMethod
    settings = MappingProxyType({"samples": 20, "round_size": 6})
    budget = 60


class TestReplay(LearnerSuite):
    method = Replay
    settings = MappingProxyType({"round_size": 6, "repeats": 2})
    budget = 60


class TestAdaptiveStressTesting(LearnerSuite):
    method = AdaptiveStressTesting
    settings = MappingProxyType(
        {"round_size": 4, "warm_up": 4, "buffer_size": 70, "gradient_steps": 2}
    )


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
