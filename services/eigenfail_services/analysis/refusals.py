"""What cannot be analysed, and why; loads nothing heavy."""

import numpy as np

from eigenfail.errors import InvalidValue
from eigenfail.values import AnalysisSettings, Floats


def check_clusterer(settings: AnalysisSettings) -> None:
    """Raises InvalidValue for a number of groups that the clusterer would not heed."""
    if settings.clusters is not None and settings.clusterer == "hdbscan":
        problem = "hdbscan finds the number of modes itself."
        raise InvalidValue("clusters", problem, "Leave it out, or take clusterer kmeans.")


def check_noise(z: Floats, index: int, horizon: int) -> None:
    """Raises InvalidValue for noise that is not finite of shape (at most `horizon`, 2)."""
    if z.ndim != 2 or z.shape[1] != 2 or len(z) > horizon or not np.isfinite(z).all():
        raise InvalidValue(
            "failures",
            f"the noise of episode {index} is not finite of shape (at most {horizon}, 2).",
            "Analyse campaigns of one horizon, and check the store that it came from.",
        )


def nothing_to_analyse() -> InvalidValue:
    """The refusal where there is no failure."""
    return InvalidValue(
        "failures",
        "there is none to analyse.",
        "Let the campaign run on, or search with a method that looks for them: ast, cem, difs.",
    )
