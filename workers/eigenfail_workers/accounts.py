"""What planners say of their decisions, step by step, as explanations keep it."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from eigenfail.errors import read_text
from eigenfail.values import Account, Control, Path

MAX_POINTS = 20
"""Most points that are kept of a path, evenly chosen."""


class RecordedStep(NamedTuple):
    """The planner's decision in a step, and its explanation."""

    time_s: float
    control: Control
    account: Account
    path: Path


def read_account(given: Mapping[str, object]) -> Account:
    """Return an account with texts and floats alone."""
    return {read_text(name): _to_plain(value) for name, value in given.items()}


def _to_plain(value: object) -> str | float:
    return float(value) if isinstance(value, (int, float)) else read_text(value)


def thin_path(path: Sequence[tuple[float, float]]) -> Path:
    """Return at most MAX_POINTS points of a path, its ends included."""
    last = len(path) - 1
    kept: Sequence[int] = range(last + 1)
    if last >= MAX_POINTS:
        kept = [place * last // (MAX_POINTS - 1) for place in range(MAX_POINTS)]
    return tuple((float(path[place][0]), float(path[place][1])) for place in kept)
