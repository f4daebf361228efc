"""Failures of which is known what the ego did in them, and what it struck."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from eigenfail.values.analysis import AnalysisSettings
from eigenfail.values.arrays import Floats
from eigenfail.values.records import FailureCourse, Failures
from eigenfail_services.analysis.alignment import Aligned, FailureBatch, gather_failures
from eigenfail_services.analysis.behaviour import read_motion

STEPS, STEP_S = 60, 0.1
SIZES = np.array([(16.0, 2.5), (5.0, 2.0), (5.0, 2.0)], np.float32)
EGO = (0.0, 0.0, 0.0, 20.0)


def gather_courses(
    accelerations: Sequence[Floats],
    others: Sequence[Any] | None = None,
    order: Sequence[int] | None = None,
) -> Aligned:
    """Failures of 60 steps whose noise shows nothing, each by what the ego did in it.

    Args:
        accelerations: of the ego in each failure. [m/s²]
        others: where the other vehicles are in the end, in the order of their numbers.
        order: in which the failures are read.
    """
    random = np.random.default_rng(3)
    noise = [random.standard_normal((STEPS, 2)).astype(np.float32) for _ in accelerations]
    order = range(len(noise)) if order is None else order
    courses = []
    for index in order:
        speeds = (40.0 + STEP_S * np.cumsum([0.0, *accelerations[index]])).astype(np.float32)
        end = () if others is None else (np.array([[EGO, *others[index]]] * 2, np.float32), SIZES)
        courses.append((1, FailureCourse(index, STEP_S, speeds, *end)))
    batch = FailureBatch(1, Failures(tuple(order), tuple(noise[index] for index in order)))
    return gather_failures([batch], STEPS, AnalysisSettings())._replace(
        motion=read_motion(courses, "collision"), step_s=STEP_S
    )
