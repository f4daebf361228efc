"""Some of many: how many a page can bear."""

from collections.abc import Sequence
from typing import TypeVar

Item = TypeVar("Item")


def evenly(items: Sequence[Item], most: int) -> list[Item]:
    """At most so many of them, spread evenly."""
    taken = min(len(items), most)
    return [items[place * len(items) // taken] for place in range(taken)] if taken else []


def in_groups(items: Sequence[Item], size: int) -> list[Sequence[Item]]:
    """Neighbours, so many at a time."""
    return [items[first : first + size] for first in range(0, len(items), size)]


def sample_note(shown: int, of: int, things: str) -> str:
    """That not all of them are shown; empty if they are."""
    return "" if shown >= of else f"A sample of {shown:,} of {of:,} {things}, spread evenly."
