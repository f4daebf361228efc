"""What the rows of a value's table are.

A list, or any sequence of values, has a row for each; a course its blocks, safety its failures, an
analysis a row for each failure with its mode and scores, a comparison its two sides, a cost its
curve, noise its steps, a suite its members with what sets them apart and what they found.
"""

from collections.abc import Iterable, Iterator, Mapping
from enum import Enum
from functools import singledispatch
from typing import Any

import msgspec
import numpy as np

from eigenfail.errors import InvalidValue
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
    raise InvalidValue("value", problem, "Give a list, or a value of ours.")


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
    for step, (metres, z, sigma) in enumerate(zip(value.metres, value.z, value.sigma, strict=True)):
        row: Record = {"step": step}
        for axis, name in enumerate(AXES):
            row |= {f"{name}_m": float(metres[axis]), f"{name}_z": float(z[axis])}
            row |= {f"{name}_sigma_m": float(sigma[axis])}
        yield row


@records.register
def _(value: EpisodeResult) -> Iterator[Record]:
    return records(value.noise)


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
        raise InvalidValue("analysis", why, "Take one that is done: client.analyses.wait(id).")
    return analysis.result


def flat(row: object) -> Record:
    """The fields of a value, those of its fields beside them; arrays are left out."""
    if not isinstance(row, msgspec.Struct):
        return dict(row) if isinstance(row, Mapping) else {"value": row}
    found: Record = {}
    for name in row.__struct_fields__:
        content = getattr(row, name)
        if isinstance(content, msgspec.Struct):
            found |= {f"{name}_{inner}": each for inner, each in flat(content).items()}
        elif not isinstance(content, np.ndarray):
            found[name] = content.value if isinstance(content, Enum) else content
    return found
