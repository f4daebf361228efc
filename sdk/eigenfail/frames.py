"""Values as tables: for pandas, which is optional, and for numpy.

`tabulation` says what the rows are. Columns are the fields; a field of a field is `outer_inner`.
Units are in the names or, like those of severity [m²/s²], in the documents of the values.
"""

from collections.abc import Iterable, Mapping, Sequence
from functools import singledispatch
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from eigenfail.errors import ServiceError
from eigenfail.tabulation import Record, records, result_of
from eigenfail.values import Analysis, AnalysisResult, EpisodeResult, NoiseTrajectory

if TYPE_CHECKING:
    import pandas as pd

EMPTY = np.empty(0, dtype=[])
NUMBER = (int, float)


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
            "pandas is not installed.", "Run: pip install 'eigenfail[export]'; or use to_numpy()."
        ) from error
    return pd.DataFrame(columns_of(records(value)))


@singledispatch
def to_numpy(value: object) -> NDArray[np.generic]:
    """The table of a value, or of a sequence of values, as a structured array.

    A number that is not known is NaN, a text that is not known is empty.

    Raises:
        InvalidValue: there is no table in it.
    """
    columns = {name: array(column) for name, column in columns_of(records(value)).items()}
    if not columns:
        return EMPTY
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
    return value.metres


@to_numpy.register
def _(value: EpisodeResult) -> NDArray[np.generic]:
    return value.noise.metres


def columns_of(rows: Iterable[Record]) -> dict[str, list[Any]]:
    """The columns of a table; what a row does not have is not known."""
    table = list(rows)
    names = dict.fromkeys(name for row in table for name in row)
    columns = {name: [row.get(name) for row in table] for name in names}
    return {
        name: fill_column(column) for name, column in columns.items() if not hollow(name, columns)
    }


def hollow(name: str, columns: Mapping[str, Sequence[Any]]) -> bool:
    """Whether a column has nothing but a place for fields that stand in columns of their own."""
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


def array(column: list[Any]) -> NDArray[np.generic]:
    """A column as an array; of objects where it holds neither numbers nor texts alone."""
    if all(isinstance(each, NUMBER) for each in column) or all(
        isinstance(each, str) for each in column
    ):
        return np.array(column)
    kept = np.empty(len(column), dtype=object)
    kept[:] = column
    return kept
