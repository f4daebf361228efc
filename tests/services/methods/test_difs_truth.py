"""What DiFS samples against the true p(x | failure), found by rejection."""

import numpy as np
import pytest
from scipy.stats import ks_2samp

from eigenfail.settings import read_settings
from eigenfail.testing.learner import Corridor, ToyEngine
from eigenfail.values.episode import learner_seed
from eigenfail.values.learning import LearnerContext
from eigenfail_services.campaigns.rounds import Rounds, run_in_process
from eigenfail_services.methods.difs.method import DiffusionFailureSampling

CORRIDOR = Corridor(wall=0.8)


def truth(corridor):
    """Failures among draws from the prior, shape (n, steps, 2), zero behind their ends."""
    random = np.random.default_rng(7)
    found = []
    for _ in range(10):
        z = random.standard_normal((20_000, corridor.steps, 2))
        failed = (corridor.course(z) >= corridor.wall).any(axis=1)
        found.extend(cut(z[failed], corridor))
    return found


def cut(z, corridor):
    ends = (corridor.course(z) >= corridor.wall).argmax(axis=1) + 1
    return [one[:end] for one, end in zip(z, ends, strict=True)]


def features(failures):
    """When it ended, mean longitudinal noise in the last ten steps, mean lateral noise."""
    return np.array([(len(z) / 40, z[-10:, 0].mean(), z[:, 1].mean()) for z in failures])


def log_p(failures):
    return -0.5 * sum((z**2).sum() for z in failures) / sum(map(len, failures))


def test_failures_are_distributed_nearly_as_the_true_ones():
    given = {"final_share": 0.4, "device": "cpu", "steps": 20}
    nothing = np.zeros((0, CORRIDOR.steps, CORRIDOR.channels), np.float32)
    learner = DiffusionFailureSampling(
        LearnerContext(learner_seed(3060), 700, CORRIDOR.steps, nothing),
        read_settings(DiffusionFailureSampling.Settings, given, "settings"),
    )
    results = list(run_in_process(Rounds(learner, 3060, 700), ToyEngine(CORRIDOR)))
    final = results[-280:]
    sampled = [result.noise.z for result in final if result.is_failure]
    real = truth(CORRIDOR)
    assert len(real) < 0.01 * 200_000
    assert len(sampled) / len(final) > 0.1
    pairs = zip(features(real).T, features(sampled).T, strict=True)
    end, *noise = (ks_2samp(*pair).statistic for pair in pairs)
    assert max(noise) < 0.25
    assert end < 0.45  # DiFS knows one time to crash better than others.
    assert log_p(sampled) == pytest.approx(log_p(real), rel=0.25)
