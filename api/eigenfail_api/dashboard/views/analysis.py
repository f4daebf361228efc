"""One analysis: what PCA and K-means found in the failures, and what became of it."""

from collections.abc import Sequence

import msgspec
import numpy as np

from eigenfail.values import Analysis, AnalysisResult, Campaign, FailureMode
from eigenfail.values.records import EpisodeRow
from eigenfail_api.dashboard import formats
from eigenfail_api.dashboard.views.charts import Chart
from eigenfail_api.dashboard.views.diversity import diversity_tiles
from eigenfail_api.dashboard.views.lists import (
    AnalysisLine,
    EpisodeLine,
    analysis_line,
    episode_line,
)
from eigenfail_api.dashboard.views.modes import (
    eigenfailure_chart,
    explained_chart,
    influence_chart,
    scores_chart,
)
from eigenfail_api.dashboard.views.summaries import Figure


class ModeLine(msgspec.Struct, frozen=True):
    """A failure mode in the table.

    Attributes:
        peak: the strongest noise of its eigenfailure, in words.
        strength: root mean square of its eigenfailure [sigma]; noise has 1.
        replayed: what its eigenfailure did in the replay, once it was replayed.
    """

    number: int
    failures: int
    share: str
    medoid: int
    strength: str
    peak: str
    replayed: EpisodeLine | None


class AnalysisView(msgspec.Struct, frozen=True, kw_only=True):
    """The page of an analysis.

    Attributes:
        diversity: how the failures spread over modes; empty in results of older releases.
        collapse: that the modes have collapsed, and what to try; empty otherwise.
    """

    line: AnalysisLine
    campaign: int
    campaign_name: str
    is_open: bool
    verdict: str
    is_distinct: bool
    diversity: tuple[tuple[str, Figure], ...]
    collapse: str
    modes: tuple[ModeLine, ...]
    charts: tuple[Chart, ...]
    replay: int | None
    replay_state: str


def analysis_view(
    analysis: Analysis,
    campaign: Campaign,
    replay: Campaign | None,
    replayed: Sequence[EpisodeRow],
) -> AnalysisView:
    """The page of an analysis, with the results of its replay as far as they are in."""
    result = analysis.result
    return AnalysisView(
        line=analysis_line(analysis),
        campaign=campaign.id,
        campaign_name=campaign.spec.name,
        is_open=analysis.state in {"queued", "running"}
        or (replay is not None and replay.ended_ms is None),
        verdict=verdict(result) if result else "",
        is_distinct=result is not None and result.distinct,
        diversity=diversity_tiles(result.diversity) if result and result.diversity else (),
        collapse=result.diversity.warning if result and result.diversity else "",
        modes=mode_lines(result, replayed) if result else (),
        charts=charts(result) if result and result.modes else (),
        replay=replay.id if replay else None,
        replay_state=replay.state if replay else "",
    )


def charts(result: AnalysisResult) -> tuple[Chart, ...]:
    """What was found, drawn."""
    return (
        eigenfailure_chart(result),
        scores_chart(result),
        explained_chart(result),
        influence_chart(result),
    )


def verdict(result: AnalysisResult) -> str:
    """Whether the modes are real, in words."""
    if result.silhouette is None or result.noise_silhouette is None:
        return "A single mode: there is nothing to tell apart."
    against = (
        f"silhouette {formats.number(result.silhouette, 2)} against "
        f"{formats.number(result.noise_silhouette, 2)} for structureless data of the same "
        "covariance"
    )
    if result.distinct:
        return f"The modes are distinct: {against}."
    return (
        f"The modes are not shown to be distinct: {against}. Read them as a summary of the "
        "failures, not as separate causes."
    )


def mode_lines(result: AnalysisResult, replayed: Sequence[EpisodeRow]) -> tuple[ModeLine, ...]:
    """The modes; the replay's episode i injects the eigenfailure of mode i."""
    rows = {row.index: episode_line(row) for row in replayed}
    total = len(result.episodes)
    return tuple(
        mode_line(position, mode, total, rows.get(position))
        for position, mode in enumerate(result.modes)
    )


def mode_line(
    position: int, mode: FailureMode, total: int, replayed: EpisodeLine | None
) -> ModeLine:
    """One mode; modes are counted from 1 for people."""
    return ModeLine(
        number=position + 1,
        failures=mode.failures,
        share=formats.percent(mode.failures / total),
        medoid=mode.medoid,
        strength=formats.number(float(np.sqrt(np.mean(np.square(mode.eigenfailure))))),
        peak=peak(mode),
        replayed=replayed,
    )


def peak(mode: FailureMode) -> str:
    """The strongest noise of an eigenfailure: which way, how much, when."""
    z = mode.eigenfailure
    step, axis = np.unravel_index(int(np.abs(z).argmax()), z.shape)
    value = float(z[step, axis])
    ways = (("ahead", "back"), ("towards +y", "towards −y"))
    return f"{formats.number(abs(value), 2)} sigma {ways[axis][value < 0.0]} at step {step}"
