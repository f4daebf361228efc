"""The agreement of modes with known causes: on failures whose causes show, and on mixed-up ones."""

import numpy as np
from benchmarks.truth.mode_agreement import (
    LabelledFailure,
    measure_agreement,
    measure_agreement_of_struck,
)

from eigenfail.values.analysis import AnalysisSettings
from eigenfail.values.records import FailureCourse

STEPS, STEP_S, FAILURES = 60, 0.1, 60


def test_causes_that_show_in_the_braking_agree_and_mixed_up_ones_do_not(monkeypatch):
    monkeypatch.setattr("eigenfail_services.analysis.clusters.NOISE_DRAWS", 2)
    random = np.random.default_rng(0)
    brakes = random.integers(0, 2, FAILURES)
    noise = random.standard_normal((FAILURES, STEPS, 2)).astype(np.float32)
    acceleration = 0.2 * random.standard_normal((FAILURES, STEPS))
    acceleration[brakes == 1, -15:] -= 7.0
    speeds = 24.0 + STEP_S * np.pad(np.cumsum(acceleration, axis=1), ((0, 0), (1, 0)))
    courses = [FailureCourse(n, STEP_S, each) for n, each in enumerate(speeds)]
    causes = np.where(brakes == 1, "late", "lost")
    settings = AnalysisSettings(bootstrap=0)

    def measure(labels):
        failures = [LabelledFailure(*each) for each in zip(noise, courses, labels, strict=True)]
        return measure_agreement(failures, STEPS, settings)

    assert measure(causes) == 1.0
    assert measure(random.permutation(causes)) < 0.3


def test_the_vehicle_that_was_struck_agrees_with_causes_that_are_one_of_each():
    sizes = np.array([(16.0, 2.5), (5.0, 2.0), (5.0, 2.0)], np.float32)
    ego, far = (0.0, 0.0, 0.0, 20.0), (90.0, 3.5, 0.0, 20.0)
    ahead, behind = (10.0, 0.0, 0.0, 10.0), (-10.0, 0.0, 0.0, 30.0)
    ends = [np.array([[ego, *others]] * 2) for others in ((ahead, far), (far, behind))] * 3
    speeds = np.full(3, 20.0, np.float32)

    def measure(causes):
        return measure_agreement_of_struck(
            [
                LabelledFailure(
                    np.zeros((2, 2)), FailureCourse(index, STEP_S, speeds, end, sizes), cause
                )
                for index, (end, cause) in enumerate(zip(ends, causes, strict=True))
            ]
        )

    assert measure(("cut-in", "phantom") * 3) == 1.0
    assert measure(("kept", "kept", "lost") * 2) < 0.5
