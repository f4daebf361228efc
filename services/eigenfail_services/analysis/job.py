"""The analysis of failures: from their noise to failure modes."""

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
        failures: z of each, shape (its steps, channels).
        horizon: steps of a full episode of the campaign.
        settings: how to go about it.
        channels: the names of the columns of z.

    Raises:
        UnknownName: the settings name no channel of these.
        InvalidValue: there is no failure, or one that does not fit the horizon and the channels; or
            a number of clusters that the clusterer takes none of.
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
    """PCA, clustering and the way back to noise; the same, bit for bit, whenever it is repeated.

    Components and influence stand in the alignment asked for: aligned at the collision, their last
    step is the one before the impact. Rows come in the order of campaigns and episodes.

    Args:
        gathered: all failures of the campaigns; the intervals of training are of all of them.
        settings: settings of the analysis, which were checked; there are never more components or
            modes than the failures differ in.
        step_s: duration of a step; None if it has none, or if failures do not end at a
            collision, to which times could be told. [s]
        episodes: how many of each campaign have ended, by its id.
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
    """The result of failures that stand side by side, but for what depends on their episodes."""
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
    """What share of the influence the last seconds have, in components of their own."""
    ending = failures.at_collision()
    space = fit_components(ending.data, settings.components)
    weighed = measure_influence(ending.by_step(space.components), space.explained)
    steps = alignment.median_steps(failures.steps.tolist())
    return alignment.measure_before_collision(
        weighed.astype(np.float32), steps, step_s, failures.channels
    )


def hash_result(result: AnalysisResult) -> str:
    """SHA-256 over the numbers of a result: the same whenever the analysis is repeated.

    Words are left out: the planner's account in them is given only where workers are installed, and
    only by a planner that answers in time. So are bands: they follow from labels and noise, and
    without them an analysis has the digest that it had before there were any. The names of the
    channels are those of the campaign. The behaviour of modes follows from labels and episodes.
    What an analysis of the noise does not have is left out of its digest. The number of a mode is
    its place. What its medoid drew, and how long its failures lasted, follow from the episodes.
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
