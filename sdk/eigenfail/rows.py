"""Rows: what lists give. They come page by page, as they are wanted."""

from collections.abc import Callable, Iterable, Iterator
from itertools import islice
from typing import Generic, TypeVar

from eigenfail.values.showing import Shown, Tabular

Row = TypeVar("Row")

SHOWN = 20


class Rows(Iterable[Row], Shown, Tabular, Generic[Row]):
    """A list on a service: nothing is asked before the first row is wanted.

    Each iteration asks anew, so that a list of millions needs no memory; `list(rows)` keeps them.

    Args:
        fetch: begins an iteration.
    """

    def __init__(self, fetch: Callable[[], Iterator[Row]]) -> None:
        self._fetch = fetch

    def __iter__(self) -> Iterator[Row]:
        """All rows, page by page."""
        return self._fetch()

    def first(self, n: int = SHOWN) -> tuple[Row, ...]:
        """The first n rows, or all where there are fewer."""
        return tuple(islice(self, n))

    def __repr__(self) -> str:
        """How to get at them; asks nothing."""
        return "<Rows: iterate, or take first(n), to_pandas(), to_numpy()>"
