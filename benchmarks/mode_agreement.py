"""How well the modes of failures agree with known causes, by the adjusted Rand index."""

from collections.abc import Mapping
from statistics import median

import numpy as np
from sklearn.metrics import adjusted_rand_score

from eigenfail.values import AnalysisSettings
from eigenfail_services.analysis.alignment import Aligned
from eigenfail_services.analysis.job import analyse_gathered

SUBSAMPLES = 5
LEAST = 30
"""Failures of a subsample: half of all, but at least these, as fewer show few modes."""


def measure_agreement(
    failures: Aligned, causes: Mapping[int, str], settings: AnalysisSettings, step_s: float
) -> tuple[float, ...]:
    """Return the index of the modes of each of five subsamples, drawn without replacement.

    Args:
        failures: failures of one campaign, with the motion of the ego.
        causes: cause of each, by index of the episode.
        settings: settings of the analysis.
        step_s: duration of a step. [s]
    """
    count = len(failures.episodes)
    size = min(count, max(LEAST, count // 2))
    found = []
    for seed in range(SUBSAMPLES):
        rows = np.sort(np.random.default_rng(seed).choice(count, size, replace=False))
        result = analyse_gathered(failures.take(rows), settings, step_s, {})
        truth = [causes[episode] for episode in result.episodes]
        found.append(float(adjusted_rand_score(truth, result.labels)))
    return tuple(found)


def find_median(failures: Aligned, causes: Mapping[int, str], step_s: float) -> float:
    """Return the median index of analyses with the default settings."""
    return median(measure_agreement(failures, causes, AnalysisSettings(bootstrap=0), step_s))
