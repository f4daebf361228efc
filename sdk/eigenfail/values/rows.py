"""Lists on a service, whose rows are only requested when they are needed."""

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from itertools import islice
from operator import index as convert_index
from sys import maxsize
from typing import Any, Generic, SupportsIndex, TypeVar, overload
from weakref import ReferenceType, ref

from eigenfail.values.showing import Shown

Row = TypeVar("Row")


SHOWN = 20


class _Walk(Iterator[Row]):
    """Iterator over all rows of a list, which can load rows ahead."""

    def __init__(self, source: Iterator[Row]) -> None:
        self._source = source
        self._loaded: deque[Row] = deque()
        self.is_started = False

    def __next__(self) -> Row:
        self.is_started = True
        return self._loaded.popleft() if self._loaded else next(self._source)

    def load_all(self) -> int:
        """Load the remaining rows, and return their number."""
        try:
            self._loaded.extend(self._source)
        except Exception as error:
            # Python takes a TypeError for a length that is not known, and would iterate on.
            self._source = map(_raise, (error,))
            raise
        return len(self._loaded)

    def close(self) -> None:
        """End the iteration."""
        getattr(self._source, "close", lambda: None)()


def _raise(error: Exception) -> Any:
    raise error


class Rows(Iterable[Row], Shown, Generic[Row]):
    """A list on a service; requests are only sent when rows or their number are needed.

    Each iteration requests the rows again, so that a list of millions does not fill the memory. Use
    `list(rows)` to keep them.

    Args:
        fetch: begins an iteration over all rows.
        start: begins an iteration that requests at most that many rows; None: use `fetch`.
        count: returns the number of rows; None: rows are counted one by one.
        backwards: begins an iteration from the last row towards the first that requests at most
            that many rows; None if the list cannot be read backwards.
        of: the class of the rows, or the names of their fields if rows are dicts; None: unknown. It
            gives an empty list the columns of a table.
    """

    def __init__(
        self,
        fetch: Callable[[], Iterator[Row]],
        *,
        start: Callable[[int], Iterator[Row]] | None = None,
        count: Callable[[], int] | None = None,
        backwards: Callable[[int], Iterator[Row]] | None = None,
        of: type | tuple[str, ...] | None = None,
    ) -> None:
        self._fetch = fetch
        self._start = start
        self._count = count
        self._backwards = backwards
        self.of = of
        self._latest: ReferenceType[_Walk[Row]] | None = None

    def __iter__(self) -> Iterator[Row]:
        """Return an iterator over all rows, page by page."""
        walk = _Walk(self._fetch())
        self._latest = ref(walk)
        return walk

    def __reversed__(self) -> Iterator[Row]:
        """Return an iterator from the last row to the first, page by page if possible."""
        return reversed(tuple(self)) if self._backwards is None else self._backwards(maxsize)

    def __len__(self) -> int:
        """Return the number of rows, with a single request if the service counts them."""
        # `list(rows)` and `tuple(rows)` begin an iteration and then want to know its length: its
        # rows answer that, so that no row is asked for twice, and none is counted.
        walk = self._latest() if self._latest else None
        return self.count() if walk is None or walk.is_started else walk.load_all()

    def __bool__(self) -> bool:
        """Return whether there is a row, which takes a request for a single row."""
        return bool(self.first(1))

    @overload
    def __getitem__(self, place: SupportsIndex) -> Row: ...

    @overload
    def __getitem__(self, place: slice) -> tuple[Row, ...]: ...

    def __getitem__(self, place: SupportsIndex | slice) -> Row | tuple[Row, ...]:
        """Return one row, or the rows of a slice as a tuple; negative places count from the end.

        Rows are requested from the nearer end if the place shows which end that is, and only up to
        the last row needed.

        Raises:
            IndexError: there are fewer rows.
        """
        return self._slice(place) if isinstance(place, slice) else self._find(convert_index(place))

    def count(self) -> int:
        """Return the number of rows, as `len(rows)` does."""
        return sum(1 for _ in self) if self._count is None else self._count()

    def first(self, n: int = SHOWN) -> tuple[Row, ...]:
        """Return the first n rows, or all rows if there are fewer."""
        return tuple(islice(self._begin(n), n))

    def __repr__(self) -> str:
        """Return instructions for access to the rows, without a request."""
        return "<Rows: iterate, or take len(rows), rows[i], rows[i:j], first(n)>"

    def _begin(self, n: int) -> Iterator[Row]:
        return self._fetch() if self._start is None else self._start(n)

    def _find(self, place: int) -> Row:
        rows = self._take_last(-place) if place < 0 else self._slice(slice(place, place + 1))
        if len(rows) < max(-place, 1):
            raise IndexError(f"There is no row {place}.")
        return rows[0]

    def _take_last(self, n: int) -> tuple[Row, ...]:
        """Return the last n rows in their order, or all rows if there are fewer."""
        if self._backwards is None:
            return tuple(deque(self, n))
        return tuple(islice(self._backwards(n), n))[::-1]

    def _slice(self, place: slice) -> tuple[Row, ...]:
        if is_from_start(place):
            source = self._fetch() if place.stop is None else self._begin(place.stop)
            return tuple(islice(source, place.start, place.stop, place.step))
        if is_tail(place):
            return self._take_last(-place.start)
        wanted = range(self.count())[place]
        if not wanted:
            return ()
        low, high = min(wanted), max(wanted)
        rows = tuple(islice(self._begin(high + 1), low, high + 1))
        return tuple(rows[each - low] for each in wanted if each - low < len(rows))


def is_from_start(place: slice) -> bool:
    """Return whether a slice counts forwards from the first row."""
    bounds = (place.start, place.stop)
    return all(each is None or each >= 0 for each in bounds) and (place.step or 1) > 0


def is_tail(place: slice) -> bool:
    """Return whether a slice takes the last n rows without gaps."""
    return (place.start or 0) < 0 and place.stop is None and place.step in {None, 1}
