"""Whether the clusters come back when the failures are drawn again."""

import numpy as np
from sklearn.metrics import adjusted_rand_score

from eigenfail.values import AnalysisSettings, Floats, Interval, Stability
from eigenfail_services.analysis.clusterers import CLUSTERERS, SEED, Labels
from eigenfail_services.analysis.clusters import divide, drawn
from eigenfail_services.analysis.components import fit

# Of more failures, these many drawn ones are drawn again: what is stable with few is with many.
ROWS = 2000


def stability(data: Floats, labels: Labels, settings: AnalysisSettings) -> Stability | None:
    """The adjusted Rand index under the bootstrap (Efron 1979; Hubert and Arabie 1985).

    Everything is done anew on each draw: components, the number of modes unless it is given, modes.
    The failures of a draw, each counted once, are compared by their modes there and before.

    Args:
        data: D, shape (failures, columns).
        labels: the mode of each failure, shape (failures,).
        settings: of the analysis.

    Returns:
        None with a single mode, or without resamples.
    """
    if settings.bootstrap == 0 or len(np.unique(labels)) < 2:
        return None
    rows = drawn(len(data), ROWS)
    generator = np.random.default_rng(SEED)
    found = [
        likeness(data, labels, generator.choice(rows, len(rows)), settings)
        for _ in range(settings.bootstrap)
    ]
    low, median, high = np.quantile(found, (0.025, 0.5, 0.975)).tolist()
    return Stability(settings.bootstrap, len(rows), median, Interval(low, high))


def likeness(data: Floats, labels: Labels, resample: Labels, settings: AnalysisSettings) -> float:
    """The adjusted Rand index between the modes of a draw and those of the same failures before."""
    space = fit(data[resample], settings.components)
    again = divide(space.scores, settings.clusters, CLUSTERERS[settings.clusterer])
    rows, first = np.unique(resample, return_index=True)
    return float(adjusted_rand_score(labels[rows], again.labels[first]))
