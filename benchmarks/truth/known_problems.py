"""Failure problems of known probability: those of examples/known, and more of their kinds.

Several regions, curved borders, 1 to 200 dimensions.
"""

import sys
from pathlib import Path

sys.path.append(str(Path(__file__).parents[2] / "examples" / "known"))

from known import PROBLEMS as EXAMPLES
from known import Noise, Problem, four_half_spaces, half_space, two_half_spaces, two_sided

__all__ = [
    "PROBLEMS",
    "Noise",
    "Problem",
    "four_branches",
    "four_half_spaces",
    "half_space",
    "two_half_spaces",
    "two_modes",
    "two_sided",
    "walk",
]


def two_modes() -> Problem:
    """Two corners."""
    return EXAMPLES["two_corners"]


def four_branches() -> Problem:
    """A series system of four branches."""
    return EXAMPLES["four_branches"]


def walk() -> Problem:
    """A random walk that leaves a band."""
    return EXAMPLES["walk"]


PROBLEMS = (
    *(half_space(p) for p in (1e-3, 1e-4, 1e-5, 1e-6)),
    two_half_spaces(1e-3, 1e-3),
    two_half_spaces(1e-5, 1e-5),
    *EXAMPLES.values(),
)
