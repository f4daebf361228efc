"""The agreement of modes with known causes: on failures whose causes show, and on mixed-up ones."""

from pathlib import Path

import numpy as np
import pytest

from eigenfail.values import AnalysisSettings
from eigenfail.values.records import SpeedCourse

ROOT = Path(__file__).parents[2]
STEPS, STEP_S, FAILURES = 60, 0.1, 60


@pytest.fixture(autouse=True)
def benchmarks(monkeypatch):
    monkeypatch.syspath_prepend(ROOT / "benchmarks")


def test_causes_that_show_in_the_braking_agree_and_mixed_up_ones_do_not(monkeypatch):
    from mode_agreement import LabelledFailure, measure_agreement

    monkeypatch.setattr("eigenfail_services.analysis.clusters.NOISE_DRAWS", 2)
    random = np.random.default_rng(0)
    brakes = random.integers(0, 2, FAILURES)
    noise = random.standard_normal((FAILURES, STEPS, 2)).astype(np.float32)
    acceleration = 0.2 * random.standard_normal((FAILURES, STEPS))
    acceleration[brakes == 1, -15:] -= 7.0
    speeds = 24.0 + STEP_S * np.pad(np.cumsum(acceleration, axis=1), ((0, 0), (1, 0)))
    courses = [SpeedCourse(n, STEP_S, each) for n, each in enumerate(speeds)]
    causes = np.where(brakes == 1, "late", "lost")
    settings = AnalysisSettings(bootstrap=0)

    def measure(labels):
        failures = [LabelledFailure(*each) for each in zip(noise, courses, labels, strict=True)]
        return measure_agreement(failures, STEPS, settings)

    assert measure(causes) == 1.0
    assert measure(random.permutation(causes)) < 0.3
