"""Analysis of failures: from their noise to failure modes."""

import hashlib
from collections.abc import Mapping

import msgspec
import numpy as np
from msgspec import msgpack
from msgspec.structs import replace
from sklearn import config_context
from threadpoolctl import threadpool_limits

from eigenfail.values.analysis import AnalysisResult, AnalysisSettings, InfluenceShare
from eigenfail.values.arrays import encode_array
from eigenfail.values.disturbance import AXES
from eigenfail.values.records import Failures
from eigenfail_services.analysis import alignment, clusters
from eigenfail_services.analysis.behaviour import GroupingFeatures, select_features
from eigenfail_services.analysis.components import (
    ComponentSpace,
    Spaces,
    describe_modes,
    fit_components,
    measure_influence,
)
from eigenfail_services.analysis.training import measure_diversity, summarize_training

LEAN = {"assume_finite": True, "skip_parameter_validation": True}
"""The noise was checked when it was gathered; clusterers run by the hundred."""


def analyse(
    failures: Failures,
    horizon: int,
    settings: AnalysisSettings,
    channels: tuple[str, ...] = AXES,
) -> AnalysisResult:
    """Analyse a single campaign, with id 1 and without times; see `analyse_gathered`.

    Args:
        failures: z of each failure, shape (its steps, channels).
        horizon: steps of a full episode of the campaign.
        settings: settings of the analysis.
        channels: the names of the columns of z.

    Raises:
        UnknownName: the settings name a channel that does not exist.
        InvalidValue: failures are missing, or one does not fit the horizon and the channels; or a
            number of clusters is set that the clusterer does not accept.
    """
    alignment.check_clusterer(settings)
    gathered = alignment.gather_failures(
        [alignment.FailureBatch(1, failures)], horizon, settings, channels
    )
    return analyse_gathered(gathered, settings, None, {})


def analyse_gathered(
    gathered: alignment.Aligned,
    settings: AnalysisSettings,
    step_s: float | None,
    episodes: Mapping[int, int],
    early: alignment.EarlyFailures = alignment.NONE_EARLY,
) -> AnalysisResult:
    """Run PCA, clustering and the transform back to noise, bit for bit repeatable.

    Components and influence have the alignment of the settings. If they are aligned at the
    collision, their last step is the step before the impact. Rows are ordered by campaigns and
    episodes.

    Args:
        gathered: all failures of the campaigns; the training intervals cover all of them.
        settings: checked settings of the analysis; the result never has more components or modes
            than the failures differ in.
        step_s: duration of a step; None if steps are not timed, or if failures do not end at a
            collision, the origin of times. [s]
        episodes: number of ended episodes of each campaign, by its id.
        early: failures that `failures = "latest"` leaves out.
    """
    only_latest = settings.failures == "latest"
    failures = early.leave_out(gathered) if only_latest else gathered
    # A sum over two threads rounds otherwise than over one.
    with threadpool_limits(limits=1), config_context(**LEAN):
        features = select_features(failures, settings)
        space = fit_components(failures.data, settings.components)
        result = _make_result(failures, settings, features, space, step_s)
        return replace(
            result,
            training=summarize_training(gathered, space, episodes),
            diversity=measure_diversity(failures, result, episodes),
        )


def _make_result(
    failures: alignment.Aligned,
    settings: AnalysisSettings,
    features: GroupingFeatures,
    space: ComponentSpace,
    step_s: float | None,
) -> AnalysisResult:
    """Return the result for aligned failures, without the parts that depend on their episodes."""
    clusterer = clusters.CLUSTERERS[settings.clusterer]
    asked = replace(settings, components=features.components)
    grouping = space
    if features.name != "noise":
        grouping = fit_components(features.data, features.components)
    groups = grouping.scores, settings.clusters, clusterer, features.resolution
    # The same arguments as for data without groups below, or the two silhouettes would not
    # compare.
    partition = clusters.divide(*groups)
    labels = clusters.order_by_size(partition.labels, failures.episodes)
    components = failures.by_step(space.components)
    weighed = measure_influence(components, space.explained).astype(np.float32)
    single, order = partition.silhouette is None, failures.order
    return AnalysisResult(
        episodes=tuple(failures.episodes[order].tolist()),
        explained=space.explained.astype(np.float32),
        components=components.astype(np.float32),
        scores=space.scores[order].astype(np.float32),
        labels=tuple(labels[order].tolist()),
        modes=describe_modes(failures, Spaces(space, grouping), labels, settings.centre),
        influence=weighed,
        silhouette=partition.silhouette,
        noise_silhouette=None if single else clusters.compute_noise_silhouette(*groups),
        campaigns=tuple(failures.campaigns[order].tolist()),
        stability=clusters.measure_stability(features.data, labels, asked, features.resolution),
        outliers=partition.outliers,
        moments=alignment.find_moments(weighed, failures, step_s),
        before_collision=_measure_impending(failures, settings, step_s),
        channels=failures.channels,
        features=features.name,
        behaviour=features.describe(grouping, labels, order),
    )


def _measure_impending(
    failures: alignment.Aligned, settings: AnalysisSettings, step_s: float | None
) -> tuple[InfluenceShare, ...]:
    """Return the influence of the last seconds, with components aligned at the collision."""
    ending = failures.at_collision()
    space = fit_components(ending.data, settings.components)
    weighed = measure_influence(ending.by_step(space.components), space.explained)
    steps = alignment.median_steps(failures.steps.tolist())
    return alignment.measure_before_collision(
        weighed.astype(np.float32), steps, step_s, failures.channels
    )


def hash_result(result: AnalysisResult) -> str:
    """Return the SHA-256 of a result's numbers, which is the same for each repetition.

    Words are left out, because the planner's account in them exists only with installed workers and
    a planner that answers in time. Bands are left out too: they follow from labels and noise, and
    analyses from before bands existed keep their digest. Channel names belong to the campaign. The
    behaviour of modes follows from labels and episodes. Features that an analysis of the noise does
    not have are left out of its digest. The number of a mode is its place. The scenario parameters
    of a medoid, and the duration of a mode's failures, follow from the episodes.
    """
    numbers = msgspec.to_builtins(
        replace(result, words=(), digest=""), enc_hook=encode_array, builtin_types=(bytes,)
    )
    for name in ("channels", "behaviour"):
        del numbers[name]
    for mode in numbers["modes"]:
        del mode["band"], mode["number"], mode["drawn"], mode["lasting"]
    if result.features == "noise":
        del numbers["features"]
        for mode in numbers["modes"]:
            del mode["components"], mode["explained"]
    return hashlib.sha256(msgpack.encode(numbers)).hexdigest()
