"""Rows of lists: episodes and analyses."""

from collections.abc import Iterator
from urllib.parse import urlencode

import msgspec

from eigenfail.filters import Sort, Value, value_of
from eigenfail.values import (
    Analysis,
    AnalysisSettings,
    AnalysisState,
    Campaign,
    ConflictClass,
    Page,
)
from eigenfail.values.records import EpisodeRow
from eigenfail_api.dashboard import formats
from eigenfail_api.dashboard.views.states import ANALYSIS_BADGES, OUTCOME_BADGES, Badge

CLUSTERERS = {
    "kmeans": "K-means",
    "gaussian_mixture": "Gaussian mixture",
    "hdbscan": "HDBSCAN",
}


FAILURES = "outcome = collision"

FIGURES = (
    ("severity", "Severity", "m²/s²", False, True),
    ("log_probability_per_step", "log p", "per step", False, True),
    ("robustness_m", "Robustness", "m", True, False),
    ("min_ttc_s", "MinTTC", "s", True, False),
    ("max_drac_mps2", "DRAC", "m/s²", True, True),
    ("ttc_lead_s", "TTC lead", "s", True, True),
    ("drac_lead_s", "DRAC lead", "s", True, True),
    ("steps", "Steps", "", True, True),
)
"""Column, label, unit, whether small screens do without it, whether its largest are of interest."""


class EpisodeLine(msgspec.Struct, frozen=True):
    """An episode in a list, as text.

    Attributes:
        conflict: its class, beside the outcome.
        cells: figures, as in `FIGURES`.
    """

    campaign: int
    index: int
    badge: Badge
    conflict: str
    cells: tuple[str, ...]
    has_scene: bool


class Heading(msgspec.Struct, frozen=True):
    """The head of a column that a list can be sorted by.

    Attributes:
        column: as in filters.
        label: what stands there.
        unit: under it.
        is_minor: whether small screens do without it.
        address: the list, sorted by it.
        order: ascending or descending if it is sorted by it now; empty if not.
    """

    column: str
    label: str
    unit: str
    is_minor: bool
    address: str
    order: str = ""


class EpisodeList(msgspec.Struct, frozen=True):
    """Some failures, and where those behind them are.

    Attributes:
        every: where all episodes can be searched.
        next: cursor of the next ones, if there are any already.
        last: cursor behind which new ones will appear.
        is_open: whether any may still appear.
    """

    campaign: int
    every: str
    headings: tuple[Heading, ...]
    lines: tuple[EpisodeLine, ...]
    next: int | None
    last: int | None
    is_open: bool


class AnalysisLine(msgspec.Struct, frozen=True):
    """An analysis in a list."""

    id: int
    is_done: bool
    badge: Badge
    settings: str
    created: str
    problem: str


def episode_list(
    campaign: Campaign, page: Page[EpisodeRow], after: int | None = None
) -> EpisodeList:
    """The failures of a page that begins behind `after`."""
    return EpisodeList(
        campaign=campaign.id,
        every=address(campaign.id, FAILURES),
        headings=headings(campaign.id, FAILURES, None),
        lines=tuple(map(episode_line, page.items)),
        next=page.next,
        last=page.items[-1].index if page.items else after,
        is_open=may_grow(campaign),
    )


def may_grow(campaign: Campaign) -> bool:
    """Whether results may still come in."""
    return campaign.ended_ms is None and campaign.counts.open > 0


def episode_line(row: EpisodeRow) -> EpisodeLine:
    """One episode."""
    return EpisodeLine(
        campaign=row.campaign,
        index=row.index,
        badge=OUTCOME_BADGES[row.outcome],
        conflict=conflict_words(row),
        cells=tuple(cell(row, column) for column, *_ in FIGURES),
        has_scene=row.has_scene,
    )


def conflict_words(row: EpisodeRow) -> str:
    """The class, where it says more than the outcome."""
    known = row.assessed.conflict
    words = "" if known in {None, ConflictClass.NONE} else str(known).replace("_", " ")
    return row.assessed.beside(words)


def cell(row: EpisodeRow, column: str) -> str:
    """A figure of an episode."""
    value = value_of(row, column)
    return str(value) if isinstance(value, int) else formats.number(measure(value))


def measure(value: Value | None) -> float | None:
    """A value that is one."""
    return value if isinstance(value, float) else None


def address(campaign: int, conditions: str, sort: str = "index", after: int | None = None) -> str:
    """Where a list of episodes is."""
    asked = {"filter": conditions, "sort": sort, "after": after}
    usual = {"filter": "", "sort": "index", "after": None}
    given = {name: value for name, value in asked.items() if value != usual[name]}
    path = f"/campaigns/{campaign}/episodes"
    return f"{path}?{urlencode(given)}" if given else path


def headings(campaign: int, conditions: str, now: Sort | None) -> tuple[Heading, ...]:
    """The heads of the figures; what a list is sorted by turns its order round."""
    return tuple(
        Heading(
            column=column,
            label=label,
            unit=unit,
            is_minor=is_minor,
            address=address(campaign, conditions, str(turned(Sort(column, first), now))),
            order=order(now) if now and now.column == column else "",
        )
        for column, label, unit, is_minor, first in FIGURES
    )


def turned(first: Sort, now: Sort | None) -> Sort:
    """The order to offer: the more interesting end first, or the other one if it is first now."""
    return Sort(first.column, not first.descending) if first == now else first


def order(sort: Sort) -> str:
    """In the words of aria-sort."""
    return "descending" if sort.descending else "ascending"


def analysis_line(analysis: Analysis) -> AnalysisLine:
    """One analysis."""
    return AnalysisLine(
        id=analysis.id,
        is_done=analysis.state is AnalysisState.DONE,
        badge=ANALYSIS_BADGES[analysis.state],
        settings=", ".join(asked(analysis.settings)),
        created=formats.moment(analysis.created_ms),
        problem=analysis.problem,
    )


def asked(settings: AnalysisSettings) -> Iterator[str]:
    """How failures are analysed, in words."""
    both = settings.axes == "joint"
    yield f"aligned at {settings.align}"
    yield "both axes" if both else f"the {settings.axes} axis alone"
    yield formats.counted(settings.components, "component")
    yield CLUSTERERS[settings.clusterer]
    yield "modes: by itself" if settings.clusters is None else f"modes: {settings.clusters}"
    yield f"bootstrap {settings.bootstrap}" if settings.bootstrap else "no bootstrap"
    if settings.campaigns:
        yield f"with campaigns {', '.join(map(str, settings.campaigns))}"
