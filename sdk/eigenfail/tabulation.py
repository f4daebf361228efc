"""The rows of the table of a value.

A list, or any sequence of values, has a row for each; a course its blocks, safety its failures, an
analysis a row for each failure with its mode and scores, a comparison its two sides, a cost its
curve, noise its steps, a suite its members with what sets them apart and what they found.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from enum import Enum
from functools import singledispatch
from types import MappingProxyType
from typing import Any

import msgspec
import numpy as np

from eigenfail.errors import InvalidValue
from eigenfail.filters import COLUMNS, read_value
from eigenfail.values import (
    Analysis,
    AnalysisResult,
    CampaignCost,
    Comparison,
    Course,
    EpisodeResult,
    Mode,
    NoiseTrajectory,
    Safety,
)
from eigenfail.values.campaign import Counts
from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail.values.channels import name_columns
from eigenfail.values.disturbance import number_channels
from eigenfail.values.records import EpisodeDetail, EpisodeRow
from eigenfail.values.safety import FailurePoint
from eigenfail.values.suite import SuiteTable

Record = dict[str, Any]


@singledispatch
def records(value: object) -> Iterator[Record]:
    """The rows of a value's table.

    Raises:
        InvalidValue: there is no table in it.
    """
    if isinstance(value, Iterable) and not isinstance(value, (str, bytes, Mapping)):
        return (flatten(row) for row in value if row is not None)
    if isinstance(value, msgspec.Struct):
        return iter([flatten(value)])
    problem = f"there is no table in a {type(value).__name__}."
    raise InvalidValue("value", problem, "Pass a list or an eigenfail object.")


@records.register
def _(value: Course) -> Iterator[Record]:
    return map(flatten, value.blocks)


@records.register
def _(value: Safety) -> Iterator[Record]:
    return map(flatten, value.scatter.points)


@records.register
def _(value: CampaignCost) -> Iterator[Record]:
    return map(flatten, value.curve)


@records.register
def _(value: Comparison) -> Iterator[Record]:
    yield {"side": "A", **flatten(value.a)}
    yield {"side": "B", **flatten(value.b)}


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
        yield {"index": episode, "mode": mode + 1, **named}


@records.register
def _(value: NoiseTrajectory) -> Iterator[Record]:
    return list_noise(value, number_channels(value.z.shape[1]))


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
        found = flatten(row.summary)
        # A stop rule has the name of what it counts.
        named = {
            column: f"setting_{column}" if column in found else column for column in value.columns
        }
        settings = {name: row.settings.get(column) for column, name in named.items()}
        yield {**standing, **settings, **found}


def result_of(analysis: Analysis) -> AnalysisResult:
    """What an analysis found.

    Raises:
        InvalidValue: nothing yet, or it failed.
    """
    if analysis.result is None:
        why = analysis.problem or f"analysis {analysis.id} is {analysis.state}."
        raise InvalidValue("analysis", why, "Wait for it with client.analyses.wait(id).")
    return analysis.result


def flatten(row: object) -> Record:
    """Return the fields of a value, nested fields as `outer_inner`; arrays are left out.

    Episodes have the columns of filters and files, in their order. A campaign's specification and
    its counts have columns without a prefix, as lists of campaigns are sorted by.
    """
    if not isinstance(row, msgspec.Struct):
        return dict(row) if isinstance(row, Mapping) else {"value": row}
    if isinstance(row, EpisodeRow):
        return _list_episode_columns(row)
    found: Record = {}
    for name in row.__struct_fields__:
        content = getattr(row, name)
        if isinstance(content, (CampaignSpec, Counts)):
            found |= flatten(content)
        elif isinstance(content, msgspec.Struct):
            found |= {f"{name}_{inner}": each for inner, each in flatten(content).items()}
        elif not isinstance(content, np.ndarray):
            found[name_field(type(row), name)] = _unwrap(content)
    return found


def name_field(kind: type, field: str) -> str:
    """Return the name of the column of a field."""
    return _COLUMN_NAMES.get((kind, field), field)


_COLUMN_NAMES: Mapping[tuple[type, str], str] = MappingProxyType(
    {(FailurePoint, "conflict"): "class", (Mode, "number"): "mode"}
)
"""Columns whose name in filters differs from that of the field."""


def _list_episode_columns(row: EpisodeRow) -> Record:
    judged = range(1, len(row.requirements) + 1)
    names = (*COLUMNS, *(f"requirement_{number}" for number in judged))
    columns: Record = {name: _unwrap(read_value(row, name)) for name in names}
    # No filter needs these: what is pruned is no finding, and `unresolved` follows from the rest.
    return columns | {
        "unresolved": row.assessed.unresolved,
        "noise_pruned_ms": row.noise_pruned_ms,
    }


def _unwrap(content: object) -> object:
    if isinstance(content, Enum):
        return content.value
    return None if content is msgspec.UNSET else content
