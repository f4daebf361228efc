"""From the failures of a campaign to its failure modes."""

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from eigenfail.errors import InvalidValue
from eigenfail.values import AnalysisResult, AnalysisSettings
from eigenfail.values.records import Failures
from eigenfail_services.analysis.alignment import Aligned, align
from eigenfail_services.analysis.clusters import divide, largest_first, noise_silhouette
from eigenfail_services.analysis.components import ComponentSpace, fit
from eigenfail_services.analysis.eigenfailures import modes
from eigenfail_services.analysis.influence import influence


def analyse(failures: Failures, horizon: int, settings: AnalysisSettings) -> AnalysisResult:
    """PCA, K-means and the way back to noise; the same, bit for bit, whenever it is repeated.

    Longitudinal and lateral noise are analysed together. Components and influence stand in the
    alignment asked for: aligned at the collision, their last step is the one before the impact.

    Args:
        failures: z of each, shape (its steps, 2).
        horizon: steps of a full episode of the campaign.
        settings: how to go about it; there are never more components or modes than the failures
            differ in.

    Raises:
        InvalidValue: there is no failure, or one that does not fit the horizon.
    """
    check(failures, horizon)
    order = order_of_content(failures)
    aligned = align(reordered(failures, order), horizon, settings.align)
    # A sum over two threads rounds otherwise than over one.
    with threadpool_limits(limits=1):
        return found(aligned, settings, np.argsort(order))


def found(failures: Aligned, settings: AnalysisSettings, back: NDArray[np.intp]) -> AnalysisResult:
    """The result, its rows in the order `back`."""
    space = fit(failures.data, settings.components)
    partition = divide(space.scores, settings.clusters)
    labels = largest_first(partition.labels, failures.episodes)
    components = components_by_step(space)
    return AnalysisResult(
        episodes=tuple(failures.episodes[back].tolist()),
        explained=space.explained.astype(np.float32),
        components=components.astype(np.float32),
        scores=space.scores[back].astype(np.float32),
        labels=tuple(labels[back].tolist()),
        modes=modes(failures, space, labels),
        influence=influence(components, space.explained).astype(np.float32),
        silhouette=partition.silhouette,
        noise_silhouette=(
            None
            if partition.silhouette is None
            else noise_silhouette(space.scores, settings.clusters)
        ),
    )


def components_by_step(space: ComponentSpace) -> NDArray[np.float64]:
    """The components, shape (k, steps, 2)."""
    count, columns = space.components.shape
    return space.components.reshape(count, columns // 2, 2)


def order_of_content(failures: Failures) -> list[int]:
    """An order that does not depend on when a failure was found, so that its mode does not."""

    def content(row: int) -> tuple[bytes, int]:
        return failures.noise[row].tobytes(), failures.indices[row]

    return sorted(range(len(failures.indices)), key=content)


def reordered(failures: Failures, order: list[int]) -> Failures:
    """The same failures in another order."""
    return Failures(
        tuple(failures.indices[row] for row in order), tuple(failures.noise[row] for row in order)
    )


def check(failures: Failures, horizon: int) -> None:
    """Refuse what cannot be analysed."""
    if not failures.indices:
        raise InvalidValue(
            "failures",
            "there is none to analyse.",
            "Let the campaign run on, or search with a method that looks for them: ast, cem, difs.",
        )
    for index, z in zip(failures.indices, failures.noise, strict=True):
        if z.ndim != 2 or z.shape[1] != 2 or len(z) > horizon or not np.isfinite(z).all():
            raise InvalidValue(
                "failures",
                f"the noise of episode {index} is not finite of shape (at most {horizon}, 2).",
                "Analyse campaigns of one horizon, and check the store that it came from.",
            )
