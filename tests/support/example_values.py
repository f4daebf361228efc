"""Values that several tests begin with, with nothing in them but what a test gives."""

from typing import Any

import numpy as np

from eigenfail.values.analysis import AnalysisResult
from eigenfail.values.episode import Outcome
from eigenfail.values.records import EpisodeRow

NOTHING = np.zeros((0, 2), np.float32)


def make_row(index: int = 0, outcome: Outcome = Outcome.SAFE, **changes: Any) -> EpisodeRow:
    """An episode in a list."""
    fields: dict[str, Any] = {
        "campaign": 1,
        "seed": index,
        "steps": 100,
        "source": "prior",
        "worker": "w",
        "robustness_m": 0.0,
        "log_probability": -1.0,
        "severity": None,
        "min_ttc_s": None,
        "max_drac_mps2": None,
        "wall_s": 0.5,
        "finished_ms": 0,
        "digest": "",
        "has_scene": False,
    }
    return EpisodeRow(index=index, outcome=outcome, **fields | changes)


def make_findings(**changes: Any) -> AnalysisResult:
    """An analysis of no failures, unless told otherwise."""
    fields: dict[str, Any] = {
        **dict.fromkeys(("explained", "components", "scores", "influence"), NOTHING),
        **dict.fromkeys(("episodes", "labels", "modes"), ()),
        **dict.fromkeys(("silhouette", "noise_silhouette")),
    }
    return AnalysisResult(**fields | changes)
