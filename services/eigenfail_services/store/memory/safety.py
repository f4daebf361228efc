"""Safety measures over the episodes of a campaign, in memory."""

from collections.abc import Sequence
from math import ceil
from statistics import median

import numpy as np

from eigenfail.values import FailurePoint, MeasureTotals, Outcome, SafetyTotals
from eigenfail.values.assessment import NEAR_MISS_TTC_S, PEAK_BRAKING_MPS2
from eigenfail.values.records import EpisodeRow


def safety(rows: Sequence[EpisodeRow], most: int) -> SafetyTotals:
    """Measures of the completed episodes; the rows are in index order."""
    done = [row for row in rows if row.outcome is not Outcome.FAILED]
    failures = [row for row in done if row.outcome is Outcome.COLLISION]
    points = [point(row, row.severity) for row in failures if row.severity is not None]
    ttc = [row.min_ttc_s for row in done if row.min_ttc_s is not None]
    drac = [row.max_drac_mps2 for row in done if row.max_drac_mps2 is not None]
    near = sum(each < NEAR_MISS_TTC_S for each in ttc)
    hard = sum(each > PEAK_BRAKING_MPS2 for each in drac)
    return SafetyTotals(
        completed=len(done),
        failures=len(failures),
        ttc=MeasureTotals(len(ttc), near, middle(ttc), min(ttc, default=None)),
        drac=MeasureTotals(len(drac), hard, middle(drac), max(drac, default=None)),
        severities=np.array([each.severity for each in points], np.float64),
        points=tuple(points[:: max(1, ceil(len(points) / most))]),
    )


def middle(numbers: Sequence[float]) -> float | None:
    """The median; None of nothing."""
    return median(numbers) if numbers else None


def point(row: EpisodeRow, severity: float) -> FailurePoint:
    """A failure in the scatter."""
    per_step = row.log_probability / max(row.steps, 1)
    return FailurePoint(row.index, per_step, severity, row.assessed.conflict)
