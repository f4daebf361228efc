"""The margin of a specification: how much noise a planner bears before it fails."""

from eigenfail.margin.bisection import Margin, Range, Step, find_margin
from eigenfail.margin.campaigns import known_steps, step_of, step_suite
from eigenfail.margin.words import conclusions

__all__ = [
    "Margin",
    "Range",
    "Step",
    "conclusions",
    "find_margin",
    "known_steps",
    "step_of",
    "step_suite",
]
