"""From the failures of campaigns to their failure modes."""

from collections.abc import Iterable, Mapping

import numpy as np
from msgspec.structs import replace
from sklearn import config_context
from threadpoolctl import threadpool_limits

from eigenfail.values import AnalysisResult, AnalysisSettings, InfluenceShare
from eigenfail.values.records import Failures
from eigenfail_services.analysis.alignment import Aligned, median_steps
from eigenfail_services.analysis.clusterers import CLUSTERERS
from eigenfail_services.analysis.clusters import divide, largest_first, noise_silhouette
from eigenfail_services.analysis.collapse import diversity
from eigenfail_services.analysis.components import fit
from eigenfail_services.analysis.eigenfailures import modes
from eigenfail_services.analysis.gathering import Portion, gather
from eigenfail_services.analysis.influence import influence
from eigenfail_services.analysis.moments import before_collision, moments
from eigenfail_services.analysis.refusals import check_clusterer
from eigenfail_services.analysis.stability import stability
from eigenfail_services.analysis.training import training

LEAN = {"assume_finite": True, "skip_parameter_validation": True}
"""The noise was checked when it was gathered; clusterers run by the hundred."""


def analyse(failures: Failures, horizon: int, settings: AnalysisSettings) -> AnalysisResult:
    """`analyse_portions` of a single campaign, whose id is told as 1, without times.

    Args:
        failures: z of each, shape (its steps, 2).
        horizon: steps of a full episode of the campaign.
        settings: how to go about it.

    Raises:
        InvalidValue: there is no failure, or one that does not fit the horizon; or a number of
            clusters that the clusterer takes none of.
    """
    return analyse_portions([Portion(1, failures)], horizon, settings, None, {})


def analyse_portions(
    portions: Iterable[Portion],
    horizon: int,
    settings: AnalysisSettings,
    step_s: float | None,
    episodes: Mapping[int, int],
) -> AnalysisResult:
    """PCA, clustering and the way back to noise; the same, bit for bit, whenever it is repeated.

    Components and influence stand in the alignment asked for: aligned at the collision, their last
    step is the one before the impact. Rows come in the order of campaigns and episodes.

    Args:
        portions: the failures, in any order; they are taken one portion at a time.
        horizon: steps of a full episode of the campaigns.
        settings: how to go about it; there are never more components or modes than the failures
            differ in.
        step_s: duration of a step; None where it has none. [s]
        episodes: how many of each campaign have ended, by its id.

    Raises:
        InvalidValue: there is no failure, or one that does not fit the horizon; or a number of
            clusters that the clusterer takes none of.
    """
    check_clusterer(settings)
    failures = gather(portions, horizon, settings)
    return analyse_gathered(failures, settings, step_s, episodes)


def analyse_gathered(
    failures: Aligned,
    settings: AnalysisSettings,
    step_s: float | None,
    episodes: Mapping[int, int],
) -> AnalysisResult:
    """`analyse_portions` of failures that were gathered before, with settings that were checked."""
    # A sum over two threads rounds otherwise than over one.
    with threadpool_limits(limits=1), config_context(**LEAN):
        return found(failures, settings, step_s, episodes)


def found(
    failures: Aligned,
    settings: AnalysisSettings,
    step_s: float | None,
    episodes: Mapping[int, int],
) -> AnalysisResult:
    """The result of failures that stand side by side."""
    data, clusterer = failures.data, CLUSTERERS[settings.clusterer]
    space = fit(data, settings.components)
    partition = divide(space.scores, settings.clusters, clusterer)
    labels = largest_first(partition.labels, failures.episodes)
    components = failures.by_step(space.components)
    weighed = influence(components, space.explained).astype(np.float32)
    single, order = partition.silhouette is None, failures.order
    result = AnalysisResult(
        episodes=tuple(failures.episodes[order].tolist()),
        explained=space.explained.astype(np.float32),
        components=components.astype(np.float32),
        scores=space.scores[order].astype(np.float32),
        labels=tuple(labels[order].tolist()),
        modes=modes(failures, space, labels),
        influence=weighed,
        silhouette=partition.silhouette,
        noise_silhouette=(
            None if single else noise_silhouette(space.scores, settings.clusters, clusterer)
        ),
        campaigns=tuple(failures.campaigns[order].tolist()),
        stability=stability(data, labels, settings),
        outliers=partition.outliers,
        moments=moments(weighed, failures, step_s),
        before_collision=impending(failures, settings, step_s),
        training=training(failures, space, episodes),
    )
    return replace(result, diversity=diversity(failures, result, episodes))


def impending(
    failures: Aligned, settings: AnalysisSettings, step_s: float | None
) -> tuple[InfluenceShare, ...]:
    """What share of the influence the last seconds have, in components of their own."""
    ending = failures.at_collision()
    space = fit(ending.data, settings.components)
    weighed = influence(ending.by_step(space.components), space.explained)
    steps = median_steps(failures.steps.tolist())
    return before_collision(weighed.astype(np.float32), steps, step_s)
