"""An analysis: the failures of a campaign, grouped into modes."""

from enum import StrEnum
from typing import Annotated, Literal

import msgspec

from eigenfail.values.arrays import Floats
from eigenfail.values.diversity import Diversity

MAX_CLUSTERS = 50


class AnalysisSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """How failures are analysed.

    Attributes:
        align: put the trajectories side by side at their first step or at their collision.
        components: k of the PCA.
        clusters: number of failure modes; None chooses 2 to 8 by silhouette.
    """

    align: Literal["start", "collision"] = "start"
    components: Annotated[int, msgspec.Meta(ge=1, le=MAX_CLUSTERS)] = 3
    clusters: Annotated[int, msgspec.Meta(ge=1, le=MAX_CLUSTERS)] | None = None


class AnalysisState(StrEnum):
    """Where an analysis job is."""

    QUEUED = "queued"
    RUNNING = "running"
    DONE = "done"
    FAILED = "failed"


class FailureMode(msgspec.Struct, frozen=True, eq=False):
    """A cluster of failures in PCA space.

    Attributes:
        failures: how many failures belong to it.
        medoid: index of the real episode nearest to the centre.
        centre: of the cluster in PCA space, shape (components,).
        eigenfailure: the centre taken back to noise space: z, shape (steps, 2), aligned at the
            start and ready to be injected. [sigma]
    """

    failures: int
    medoid: int
    centre: Floats
    eigenfailure: Floats


class AnalysisResult(msgspec.Struct, frozen=True, eq=False):
    """What PCA and K-means found.

    Attributes:
        episodes: index of the episode in each row of the data.
        explained: share of the variance that each component explains, shape (components,).
        components: shape (components, steps, 2); signs fixed so that the largest entry is positive.
        scores: the data in PCA space D* = (D - mu) V_k, shape (failures, components).
        labels: the mode of each failure, by position in `modes`.
        silhouette: of the clustering, from -1 to 1; None with a single mode.
        noise_silhouette: of the same clustering on structureless data of the same covariance;
            modes are distinct only where `silhouette` clearly exceeds it.
        influence: how much each step matters, shape (steps, 2): component magnitudes weighted by
            explained variance.
        diversity: how the failures spread over modes; None in results of older releases.
    """

    episodes: tuple[int, ...]
    explained: Floats
    components: Floats
    scores: Floats
    labels: tuple[int, ...]
    modes: tuple[FailureMode, ...]
    influence: Floats
    silhouette: float | None
    noise_silhouette: float | None
    diversity: Diversity | None = None

    @property
    def distinct(self) -> bool:
        """Whether the modes are more than what clustering finds in pure noise."""
        return (
            self.silhouette is not None
            and self.noise_silhouette is not None
            and self.silhouette > self.noise_silhouette
        )


class Analysis(msgspec.Struct, frozen=True, eq=False):
    """An analysis as it stands.

    Attributes:
        problem: why it failed, with the remedy; empty otherwise.
        replay_campaign: the campaign that replays its eigenfailures, once one was launched.
    """

    id: int
    campaign: int
    settings: AnalysisSettings
    state: AnalysisState
    created_ms: int
    result: AnalysisResult | None = None
    problem: str = ""
    replay_campaign: int | None = None
