"""When noise matters most, told in time before the collision."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from eigenfail.values import AXES, Floats, InfluenceShare, Moment
from eigenfail_services.analysis.alignment import Aligned, median_steps

MAX_MOMENTS = 3
MIN_STEPS_APART = 5
"""Steps that two moments of an axis are apart at least: nearer ones are one moment."""
LAST_S = (1.0, 2.0)


def find_moments(influence: Floats, failures: Aligned, step_s: float | None) -> tuple[Moment, ...]:
    """The steps of greatest influence along each axis, the greatest first.

    Only steps that half of the failures reach count: what few reach says little.

    Args:
        influence: shape (steps, 2), in the alignment of the failures.
        failures: those that were analysed.
        step_s: duration of a step; None where it has none. [s]
    """
    steps = median_steps(failures.steps.tolist())
    place = failures.alignment.place(steps, failures.horizon)
    return tuple(
        Moment(
            axis=axis,
            step=place.start + peak,
            before_collision_s=None if step_s is None else round((steps - peak) * step_s, 9),
            influence=float(course[peak]),
        )
        for axis, course in zip(AXES, influence[place].T, strict=True)
        for peak in find_peaks(course.tolist())
    )


def find_peaks(course: Sequence[float]) -> list[int]:
    """Where a course is largest, positions apart from each other, the largest first."""
    found: list[int] = []
    for step in sorted(range(len(course)), key=lambda step: (-course[step], step)):
        if len(found) == MAX_MOMENTS or course[step] <= 0.0:
            break
        if all(abs(step - other) >= MIN_STEPS_APART for other in found):
            found.append(step)
    return found


def measure_before_collision(
    influence: Floats, steps: int, step_s: float | None
) -> tuple[InfluenceShare, ...]:
    """How much of the influence lies in the last seconds before the collision.

    Args:
        influence: shape (horizon, 2), its last row that of the step before the collision.
        steps: how many of the last rows count as the time before the collision.
        step_s: duration of a step; None where it has none: there are no seconds then. [s]
    """
    if step_s is None:
        return ()
    course = influence[len(influence) - steps :].astype(np.float64)
    lasts = ((seconds, round(seconds / step_s)) for seconds in LAST_S)
    return tuple(
        InfluenceShare(
            seconds=seconds,
            time=last / steps,
            longitudinal=_compute_share(course[:, :1], last),
            lateral=_compute_share(course[:, 1:], last),
            both=_compute_share(course, last),
        )
        for seconds, last in lasts
        if 0 < last <= steps
    )


def _compute_share(course: NDArray[np.float64], last: int) -> float | None:
    """The share of the last rows in the sum over all; None of nothing."""
    total = float(course.sum())
    return float(course[-last:].sum()) / total if total > 0.0 else None
