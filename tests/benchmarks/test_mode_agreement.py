"""The agreement of modes with known causes: on failures whose causes show, and on mixed-up ones."""

from pathlib import Path

import numpy as np
import pytest

from eigenfail.values import AnalysisSettings
from eigenfail.values.records import Failures, SpeedCourse
from eigenfail_services.analysis.alignment import FailureBatch, gather_failures
from eigenfail_services.analysis.behaviour import read_motion

ROOT = Path(__file__).parents[2]
STEPS, STEP_S, FAILURES = 60, 0.1, 60


@pytest.fixture(autouse=True)
def benchmarks(monkeypatch):
    monkeypatch.syspath_prepend(ROOT / "benchmarks")


def test_causes_that_show_in_the_braking_agree_and_mixed_up_ones_do_not(monkeypatch):
    from mode_agreement import find_median

    monkeypatch.setattr("eigenfail_services.analysis.clusters.NOISE_DRAWS", 2)
    random = np.random.default_rng(0)
    brakes = random.integers(0, 2, FAILURES)
    noise = random.standard_normal((FAILURES, STEPS, 2)).astype(np.float32)
    acceleration = 0.2 * random.standard_normal((FAILURES, STEPS))
    acceleration[brakes == 1, -15:] -= 7.0
    speeds = 24.0 + STEP_S * np.pad(np.cumsum(acceleration, axis=1), ((0, 0), (1, 0)))
    courses = [(1, SpeedCourse(n, STEP_S, each)) for n, each in enumerate(speeds)]
    batch = FailureBatch(1, Failures(tuple(range(FAILURES)), tuple(noise)))
    failures = gather_failures([batch], STEPS, AnalysisSettings())
    failures = failures._replace(motion=read_motion(courses, "collision"))
    causes = {n: "late" if each else "lost" for n, each in enumerate(brakes)}
    assert find_median(failures, causes, STEP_S) == 1.0
    mixed = dict(enumerate(random.permutation([*causes.values()])))
    assert find_median(failures, mixed, STEP_S) < 0.3
