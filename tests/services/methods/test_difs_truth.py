"""What DiFS samples against the true p(x | failure), found by rejection."""

import numpy as np
import pytest
from sample_quality import sample_quality

from eigenfail.testing.learner import Corridor
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


def test_failures_are_distributed_nearly_as_the_true_ones(campaign):
    results = campaign(
        DiffusionFailureSampling, CORRIDOR, 700, seed=3060, final_share=0.4, device="cpu", steps=20
    )
    final = results[-280:]
    sampled = [result.noise.z for result in final if result.is_failure]
    real = truth(CORRIDOR)
    assert len(real) < 0.01 * 200_000
    assert len(sampled) / len(final) > 0.1
    quality = sample_quality(features(real[:150]), features(sampled))
    assert quality.density > 0.7
    # Another 100 of the true ones cover 0.87: DiFS knows one time to crash better than others.
    assert quality.coverage > 0.3
    assert log_p(sampled) == pytest.approx(log_p(real), rel=0.25)
