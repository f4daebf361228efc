"""What an analysis found besides its modes: how sure they are, and when noise matters."""

import msgspec
import numpy as np

from eigenfail.values import AnalysedCampaign, AnalysisResult, InfluenceShare, Moment
from eigenfail_api.dashboard import formats
from eigenfail_api.dashboard.views.diversity import diversity_tiles
from eigenfail_api.dashboard.views.summaries import Figure

Tiles = tuple[tuple[str, Figure], ...]
Rows = tuple[tuple[str, ...], ...]


class Grid(msgspec.Struct, frozen=True):
    """A small table: the first cell of a row heads it."""

    title: str
    columns: tuple[str, ...]
    rows: Rows
    note: str = ""


def finding_tiles(result: AnalysisResult) -> Tiles:
    """The figures of an analysis, each with what it rests on."""
    return (
        ("Failures analysed", analysed(result)),
        ("Adjusted Rand index", stability(result)),
        ("Variance explained", explained(result)),
        *((("Near no mode", outliers(result)),) if result.outliers else ()),
        *(diversity_tiles(result.diversity) if result.diversity else ()),
    )


def analysed(result: AnalysisResult) -> Figure:
    """How many failures, of what."""
    count = formats.integer(len(result.episodes))
    episodes = sum(source.episodes for source in result.sources)
    return Figure(count, (f"of {formats.counted(episodes, 'episode')}",) if episodes else ())


def stability(result: AnalysisResult) -> Figure:
    """Whether the groups come back when the failures are drawn again."""
    found = result.stability
    if found is None:
        why = "no bootstrap" if len(result.modes) > 1 else "a single group"
        return Figure(formats.NONE, (f"not tried: {why}",))
    draws = f"{found.resamples} draws of {formats.counted(found.rows, 'failure')}"
    notes = (formats.interval(found.interval), draws, "1: the same groups; 0: chance")
    return Figure(formats.number(found.median), notes)


def explained(result: AnalysisResult) -> Figure:
    """What the components keep."""
    by = formats.counted(len(result.explained), "component")
    return Figure(formats.percent(float(np.sum(result.explained))), (f"by {by}",))


def outliers(result: AnalysisResult) -> Figure:
    """The failures that were put with their nearest neighbour."""
    return Figure(formats.percent(result.outliers), ("put with their nearest neighbour",))


def grids(result: AnalysisResult) -> tuple[Grid, ...]:
    """When noise matters, and what was looked at; as far as it was told."""
    found = (moment_grid(result), share_grid(result), source_grid(result))
    return tuple(grid for grid in found if grid.rows)


def moment_grid(result: AnalysisResult) -> Grid:
    """The moments of greatest influence."""
    return Grid(
        "Moments of greatest influence",
        ("Axis", "When", "Influence"),
        tuple(
            (each.axis.capitalize(), moment(each), formats.number(each.influence))
            for each in result.moments
        ),
        "Influence: components weighted by explained variance.",
    )


def moment(found: Moment) -> str:
    """When it is, in seconds if steps have a duration."""
    if found.before_collision_s is None:
        return f"at step {found.step}"
    return f"{found.before_collision_s:.1f} s before the collision"


def share_grid(result: AnalysisResult) -> Grid:
    """Whether the last seconds matter more than the others."""
    return Grid(
        "Influence before the collision",
        ("Time", "Of the time", "Longitudinal", "Lateral", "Both"),
        tuple(map(share_row, result.before_collision)),
        "The shares would be equal to that of the time if no moment mattered more than another.",
    )


def share_row(found: InfluenceShare) -> tuple[str, ...]:
    """One span of time."""
    shares = (found.time, found.longitudinal, found.lateral, found.both)
    return (f"Last {found.seconds:g} s", *map(formats.percent, shares))


def source_grid(result: AnalysisResult) -> Grid:
    """The campaigns as they stood."""
    return Grid(
        "What was analysed",
        ("Campaign", "Failures", "Episodes", "State then"),
        tuple(map(source_row, result.sources)),
    )


def source_row(source: AnalysedCampaign) -> tuple[str, ...]:
    """One campaign."""
    counts = (formats.integer(source.failures), formats.integer(source.episodes))
    return (str(source.campaign), *counts, "running: a snapshot" if source.running else "ended")
