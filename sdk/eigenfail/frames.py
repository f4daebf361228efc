"""What the rows of a value's table are.

A list, or any sequence of values, has a row for each; a course its blocks, safety its failures, an
analysis a row for each failure with its mode and scores, a comparison its two sides, a cost its
curve, noise its steps, a suite its members with what sets them apart and what they found.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from enum import Enum
from functools import singledispatch
from itertools import islice
from typing import TYPE_CHECKING, Any, Generic, TypeVar

import msgspec
import numpy as np
from numpy.typing import NDArray

from eigenfail.errors import InvalidValue, ServiceError
from eigenfail.values import (
    AXES,
    Analysis,
    AnalysisResult,
    CampaignCost,
    Comparison,
    Course,
    EpisodeResult,
    NoiseTrajectory,
    Safety,
)
from eigenfail.values.channels import name_columns
from eigenfail.values.records import EpisodeDetail, EpisodeRow
from eigenfail.values.showing import Shown, Tabular
from eigenfail.values.suite import SuiteTable

Record = dict[str, Any]


@singledispatch
def records(value: object) -> Iterator[Record]:
    """The rows of a value's table.

    Raises:
        InvalidValue: there is no table in it.
    """
    if isinstance(value, Iterable) and not isinstance(value, (str, bytes, Mapping)):
        return (flat(row) for row in value if row is not None)
    if isinstance(value, msgspec.Struct):
        return iter([flat(value)])
    problem = f"there is no table in a {type(value).__name__}."
    raise InvalidValue("value", problem, "Pass a list or an eigenfail object.")


@records.register
def _(value: Course) -> Iterator[Record]:
    return map(flat, value.blocks)


@records.register
def _(value: Safety) -> Iterator[Record]:
    return map(flat, value.scatter.points)


@records.register
def _(value: CampaignCost) -> Iterator[Record]:
    return map(flat, value.curve)


@records.register
def _(value: Comparison) -> Iterator[Record]:
    yield {"side": "A", **flat(value.a)}
    yield {"side": "B", **flat(value.b)}


@records.register
def _(value: Analysis) -> Iterator[Record]:
    result = result_of(value)
    campaigns = result.campaigns or (value.campaign,) * len(result.episodes)
    for campaign, row in zip(campaigns, records(result), strict=True):
        yield {"campaign": campaign, **row}


@records.register
def _(value: AnalysisResult) -> Iterator[Record]:
    for episode, mode, scores in zip(value.episodes, value.labels, value.scores, strict=True):
        named = {f"score_{number}": float(score) for number, score in enumerate(scores, 1)}
        yield {"episode": episode, "mode": mode + 1, **named}


@records.register
def _(value: NoiseTrajectory) -> Iterator[Record]:
    count = value.z.shape[1]
    numbered = tuple(f"channel_{number}" for number in range(1, count + 1))
    # Noise by itself knows no names; two channels have those that they always had in tables.
    return list_noise(value, AXES if count == len(AXES) else numbered)


def list_noise(noise: NoiseTrajectory, channels: Sequence[str]) -> Iterator[Record]:
    """Return a row for each step of noise, with columns for each of its channels by these names."""
    columns = [name_columns(name) for name in channels]
    rows = zip(noise.injected, noise.z, noise.sigma, strict=True)
    for step, (injected, z, sigma) in enumerate(rows):
        row: Record = {"step": step}
        for names, a_t, z_t, sigma_t in zip(columns, injected, z, sigma, strict=True):
            row |= {names.error: float(a_t), names.z: float(z_t), names.sigma: float(sigma_t)}
        yield row


@records.register
def _(value: EpisodeResult) -> Iterator[Record]:
    return records(value.noise)


@records.register
def _(value: EpisodeDetail) -> Iterator[Record]:
    return list_noise(value.noise, value.channels)


@records.register
def _(value: SuiteTable) -> Iterator[Record]:
    for row in value.members:
        standing: Record = {"member": row.member, "state": row.state.value}
        standing["stopped_because"] = row.stopped_because
        settings = {column: row.settings.get(column) for column in value.columns}
        yield {**standing, **settings, **flat(row.summary)}


def result_of(analysis: Analysis) -> AnalysisResult:
    """What an analysis found.

    Raises:
        InvalidValue: nothing yet, or it failed.
    """
    if analysis.result is None:
        why = analysis.problem or f"analysis {analysis.id} is {analysis.state}."
        raise InvalidValue("analysis", why, "Wait for it with client.analyses.wait(id).")
    return analysis.result


def flat(row: object) -> Record:
    """Return the fields of a value, nested fields as `outer_inner`; arrays are left out.

    The requirements of an episode are numbered, and its labels one text, as in filters and files.
    """
    if not isinstance(row, msgspec.Struct):
        return dict(row) if isinstance(row, Mapping) else {"value": row}
    found: Record = {}
    for name in row.__struct_fields__:
        content = getattr(row, name)
        if isinstance(content, msgspec.Struct):
            found |= {f"{name}_{inner}": each for inner, each in flat(content).items()}
        elif not isinstance(content, np.ndarray):
            found[name] = content.value if isinstance(content, Enum) else content
    if isinstance(row, EpisodeRow):
        judged = found.pop("requirements")
        found |= {f"requirement_{number}": each for number, each in enumerate(judged, start=1)}
        found["label"] = ", ".join(found.pop("labels"))
    return found


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
            "pandas is not installed.",
            "Run in a clone: pip install '.[export]'; or use to_numpy().",
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
    return value.injected


@to_numpy.register
def _(value: EpisodeResult) -> NDArray[np.generic]:
    return value.noise.injected


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
