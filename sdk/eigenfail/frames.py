"""Values as data frames and arrays, and lists on a service."""

from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import singledispatch
from itertools import islice
from operator import index as convert_index
from sys import maxsize
from typing import TYPE_CHECKING, Any, Generic, SupportsIndex, TypeVar, overload
from weakref import ReferenceType, ref

import numpy as np
from numpy.typing import NDArray

from eigenfail.errors import ServiceError
from eigenfail.filters import ColumnKind
from eigenfail.table_columns import NO_COLUMNS, Columns, find_columns
from eigenfail.tabulation import Record, records, result_of
from eigenfail.values import Analysis, AnalysisResult, EpisodeResult, NoiseTrajectory
from eigenfail.values.showing import Shown, Tabular
from eigenfail.wire.http import encode

if TYPE_CHECKING:
    import pandas as pd
    import pyarrow as pa


NUMBER = (int, float)

_DTYPES = {
    ColumnKind.NUMBER: np.dtype(np.float64),
    ColumnKind.WHOLE: np.dtype(np.int64),
    ColumnKind.TEXT: np.dtype(object),
    ColumnKind.FLAG: np.dtype(np.bool_),
}
"""Types of the columns of a table without a row."""


def to_pandas(value: object) -> "pd.DataFrame":
    """The table of a value, or of a sequence of values, as a data frame.

    Raises:
        InvalidValue: there is no table in it.
        ServiceError: pandas is not installed.
    """
    try:
        import pandas as pd
    except ImportError as error:
        raise ServiceError(
            "pandas is not installed.",
            "Run in a clone: pip install '.[export]'; or use to_numpy().",
        ) from error
    known = find_columns(value)
    if columns := columns_of(records(value)):
        return pd.DataFrame(columns)
    return pd.DataFrame({name: pd.Series(dtype=_DTYPES[kind]) for name, kind in known.items()})


def to_arrow(value: object) -> "pa.Table":
    """The table of a value, or of a sequence of values, as an Arrow table; null if not known.

    The types of columns, other than those that come from the data, are the same for all values of
    one type, so that their tables can be concatenated.

    Raises:
        InvalidValue: there is no table in it.
        ServiceError: pyarrow is not installed.
    """
    try:
        import pyarrow as pa
    except ImportError as error:
        raise ServiceError(
            "pyarrow is not installed.",
            "Run in a clone: pip install '.[export]'; or use to_numpy().",
        ) from error
    types = {
        ColumnKind.NUMBER: pa.float64(),
        ColumnKind.WHOLE: pa.int64(),
        ColumnKind.TEXT: pa.string(),
        ColumnKind.FLAG: pa.bool_(),
    }
    known = find_columns(value)
    columns = gather_columns(records(value), known)
    chosen = {name: types[known[name]] if name in known else None for name in columns}
    return pa.table(
        {name: pa.array(simplify(column), type=chosen[name]) for name, column in columns.items()}
    )


@singledispatch
def to_numpy(value: object) -> NDArray[np.generic]:
    """The table of a value, or of a sequence of values, as a structured array.

    A number that is not known is NaN, a text that is not known is empty.

    Raises:
        InvalidValue: there is no table in it.
    """
    columns = {name: array(column) for name, column in columns_of(records(value)).items()}
    if not columns:
        known = find_columns(value)
        return np.empty(0, dtype=[(name, _DTYPES[kind]) for name, kind in known.items()])
    length = len(next(iter(columns.values())))
    table = np.empty(length, dtype=[(name, column.dtype) for name, column in columns.items()])
    for name, column in columns.items():
        table[name] = column
    return table


@to_numpy.register
def _(value: Analysis) -> NDArray[np.generic]:
    return result_of(value).scores


@to_numpy.register
def _(value: AnalysisResult) -> NDArray[np.generic]:
    return value.scores


@to_numpy.register
def _(value: NoiseTrajectory) -> NDArray[np.generic]:
    return value.injected


@to_numpy.register
def _(value: EpisodeResult) -> NDArray[np.generic]:
    return value.noise.injected


def gather_columns(rows: Iterable[Record], known: Columns = NO_COLUMNS) -> dict[str, list[Any]]:
    """Return the columns of a table; None where a row has no value.

    Args:
        rows: its rows.
        known: columns that it has in any case.
    """
    table = list(rows)
    found = dict.fromkeys(name for row in table for name in row)
    # Rows with all known columns may have others between them.
    names = found if known.keys() <= found.keys() else dict.fromkeys((*known, *found))
    columns = {name: [row.get(name) for row in table] for name in names}
    return {
        name: column
        for name, column in columns.items()
        if name in known or not _is_superfluous(name, columns, known)
    }


def _is_superfluous(name: str, columns: Mapping[str, Sequence[Any]], known: Columns) -> bool:
    """Return whether a column has nothing, and its place is taken or its type not known."""
    is_empty = bool(known) and all(each is None for each in columns[name])
    return is_empty or is_placeholder(name, columns)


def columns_of(rows: Iterable[Record]) -> dict[str, list[Any]]:
    """The columns of a table; what a row does not have is not known."""
    return {name: fill_column(column) for name, column in gather_columns(rows).items()}


def is_placeholder(name: str, columns: Mapping[str, Sequence[Any]]) -> bool:
    """Whether a column is empty because the fields of its values have columns of their own."""
    inner = any(other.startswith(f"{name}_") for other in columns)
    return inner and all(each is None for each in columns[name])


def fill_column(column: list[Any]) -> list[Any]:
    """A column in which numbers that are not known are NaN and texts that are not known empty."""
    known = [each for each in column if each is not None]
    if len(known) == len(column):
        return column
    if all(isinstance(each, str) for each in known) and known:
        return [each or "" for each in column]
    if all(isinstance(each, NUMBER) for each in known):
        return [float("nan") if each is None else each for each in column]
    return column


def simplify(column: list[Any]) -> list[Any]:
    """A column in which values other than numbers and texts are JSON, which every file can hold."""
    plain = (*NUMBER, str, type(None))
    return [each if isinstance(each, plain) else encode(each).decode() for each in column]


def array(column: list[Any]) -> NDArray[np.generic]:
    """A column as an array; of objects where it holds neither numbers nor texts alone."""
    if all(isinstance(each, NUMBER) for each in column) or all(
        isinstance(each, str) for each in column
    ):
        return np.array(column)
    kept = np.empty(len(column), dtype=object)
    kept[:] = column
    return kept


Row = TypeVar("Row")


SHOWN = 20


class _Walk(Iterator[Row]):
    """An iteration over all rows of a list, whose rows may be loaded ahead."""

    def __init__(self, source: Iterator[Row]) -> None:
        self._source = source
        self._loaded: deque[Row] = deque()
        self.is_started = False

    def __next__(self) -> Row:
        self.is_started = True
        return self._loaded.popleft() if self._loaded else next(self._source)

    def load_all(self) -> int:
        """Load the rows to come, and return their number."""
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


class Rows(Iterable[Row], Shown, Tabular, Generic[Row]):
    """A list on a service: nothing is asked before a row, or the number of rows, is wanted.

    Each iteration asks anew, so that a list of millions needs no memory; `list(rows)` keeps them.

    Args:
        fetch: begins an iteration over all rows.
        start: begins an iteration that asks for no more than so many rows; None: `fetch` does.
        count: returns the number of rows; None: they are counted one by one.
        backwards: begins an iteration from the last row towards the first that asks for no more
            than so many rows; None where the list cannot be read so.
        columns: columns of its table that do not depend on the rows, with their types.
    """

    def __init__(
        self,
        fetch: Callable[[], Iterator[Row]],
        *,
        start: Callable[[int], Iterator[Row]] | None = None,
        count: Callable[[], int] | None = None,
        backwards: Callable[[int], Iterator[Row]] | None = None,
        columns: Columns = NO_COLUMNS,
    ) -> None:
        self._fetch = fetch
        self._start = start
        self._count = count
        self._backwards = backwards
        self.columns = columns
        self._latest: ReferenceType[_Walk[Row]] | None = None

    def __iter__(self) -> Iterator[Row]:
        """All rows, page by page."""
        walk = _Walk(self._fetch())
        self._latest = ref(walk)
        return walk

    def __reversed__(self) -> Iterator[Row]:
        """All rows from the last one on, page by page where the list can be read so."""
        return reversed(tuple(self)) if self._backwards is None else self._backwards(maxsize)

    def __len__(self) -> int:
        """Number of rows; one request where the service counts them."""
        # `list(rows)` and `tuple(rows)` begin an iteration and then want to know its length: its
        # rows answer that, so that no row is asked for twice, and none is counted.
        walk = self._latest() if self._latest else None
        return self.count() if walk is None or walk.is_started else walk.load_all()

    def __bool__(self) -> bool:
        """Whether there is a row; asks for one alone."""
        return bool(self.first(1))

    @overload
    def __getitem__(self, place: SupportsIndex) -> Row: ...

    @overload
    def __getitem__(self, place: slice) -> tuple[Row, ...]: ...

    def __getitem__(self, place: SupportsIndex | slice) -> Row | tuple[Row, ...]:
        """One row, or those of a slice as a tuple; negative places count from the end.

        Rows are asked for from the nearer end where the place says which, and only up to the last
        one that is wanted.

        Raises:
            IndexError: there are fewer rows.
        """
        return self._slice(place) if isinstance(place, slice) else self._find(convert_index(place))

    def count(self) -> int:
        """Return the number of rows, as `len(rows)` does."""
        return sum(1 for _ in self) if self._count is None else self._count()

    def first(self, n: int = SHOWN) -> tuple[Row, ...]:
        """The first n rows, or all where there are fewer."""
        return tuple(islice(self._begin(n), n))

    def __repr__(self) -> str:
        """How to get at them; asks nothing."""
        return (
            "<Rows: iterate, or take len(rows), rows[i], rows[i:j], first(n), "
            "to_pandas(), to_arrow(), to_numpy()>"
        )

    def _begin(self, n: int) -> Iterator[Row]:
        return self._fetch() if self._start is None else self._start(n)

    def _find(self, place: int) -> Row:
        rows = self._take_last(-place) if place < 0 else self._slice(slice(place, place + 1))
        if len(rows) < max(-place, 1):
            raise IndexError(f"There is no row {place}.")
        return rows[0]

    def _take_last(self, n: int) -> tuple[Row, ...]:
        """The last n rows in their order, or all where there are fewer."""
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


@find_columns.register(Rows)
def _(value: Rows[Any]) -> Columns:
    return value.columns


def is_from_start(place: slice) -> bool:
    """Whether a slice counts from the first row, forwards."""
    bounds = (place.start, place.stop)
    return all(each is None or each >= 0 for each in bounds) and (place.step or 1) > 0


def is_tail(place: slice) -> bool:
    """Whether a slice is the last rows, all of them."""
    return (place.start or 0) < 0 and place.stop is None and place.step in {None, 1}
