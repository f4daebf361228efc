"""Rows of lists: episodes and analyses."""

from collections.abc import Iterator

import msgspec

from eigenfail.values import Analysis, AnalysisSettings, Campaign, Page
from eigenfail.values.records import EpisodeRow
from eigenfail_api.dashboard import formats
from eigenfail_api.dashboard.views.states import ANALYSIS_BADGES, OUTCOME_BADGES, Badge

CLUSTERERS = {
    "kmeans": "K-means",
    "gaussian_mixture": "Gaussian mixture",
    "hdbscan": "HDBSCAN",
}


class EpisodeLine(msgspec.Struct, frozen=True):
    """An episode in a list, as text."""

    campaign: int
    index: int
    badge: Badge
    robustness: str
    severity: str
    likelihood: str
    min_ttc: str
    max_drac: str
    steps: int
    has_scene: bool


class EpisodeList(msgspec.Struct, frozen=True):
    """Some failures, and where those behind them are.

    Attributes:
        next: cursor of the next ones, if there are any already.
        last: cursor behind which new ones will appear.
        is_open: whether any may still appear.
    """

    campaign: int
    lines: tuple[EpisodeLine, ...]
    next: int | None
    last: int | None
    is_open: bool


class AnalysisLine(msgspec.Struct, frozen=True):
    """An analysis in a list."""

    id: int
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
        robustness=formats.number(row.robustness_m),
        severity=formats.number(row.severity),
        likelihood=formats.number(row.log_probability / max(row.steps, 1)),
        min_ttc=formats.number(row.min_ttc_s),
        max_drac=formats.number(row.max_drac_mps2),
        steps=row.steps,
        has_scene=row.has_scene,
    )


def analysis_line(analysis: Analysis) -> AnalysisLine:
    """One analysis."""
    return AnalysisLine(
        id=analysis.id,
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
    yield f"{settings.components} components"
    yield CLUSTERERS[settings.clusterer]
    yield "modes: by itself" if settings.clusters is None else f"modes: {settings.clusters}"
    yield f"bootstrap {settings.bootstrap}" if settings.bootstrap else "no bootstrap"
    if settings.campaigns:
        yield f"with campaigns {', '.join(map(str, settings.campaigns))}"
