"""How failures and their components move through training (paper, figure of the disturbances)."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from eigenfail.values import TrainingInterval
from eigenfail_services.analysis.alignment import Aligned
from eigenfail_services.analysis.components import ComponentSpace, blocks, fit

INTERVALS = 10
SHOWN = 3


def training(
    failures: Aligned, space: ComponentSpace, episodes: Mapping[int, int]
) -> tuple[TrainingInterval, ...]:
    """Ten intervals of the episodes, each with its failures' mean and their own components.

    Args:
        failures: of one or several campaigns.
        space: the components of all of them.
        episodes: how many of each campaign have ended, by its id.
    """
    tenths = tenth_of(failures, episodes)
    return tuple(
        interval(failures, space, tenth, np.flatnonzero(tenths == tenth))
        for tenth in range(INTERVALS)
    )


def tenth_of(failures: Aligned, episodes: Mapping[int, int]) -> NDArray[np.int64]:
    """In which tenth of its campaign each failure was found, from 0, shape (failures,)."""
    tenths = np.zeros(len(failures.episodes), np.int64)
    for campaign in np.unique(failures.campaigns).tolist():
        own = failures.campaigns == campaign
        indices = failures.episodes[own]
        last = max(episodes.get(campaign, 0), int(indices.max()) + 1)
        tenths[own] = indices * INTERVALS // last
    return tenths


def interval(
    failures: Aligned, space: ComponentSpace, tenth: int, rows: NDArray[np.intp]
) -> TrainingInterval:
    """One of them, with the failures in these rows."""
    own = failures._replace(noise=failures.noise[rows])
    mean = np.zeros((failures.horizon, 2))
    for block in blocks(own.noise):
        mean += block.sum(axis=0) / len(rows)
    wanted = min(SHOWN, len(space.components))
    found = fit(own.data, wanted) if len(rows) > 1 and wanted else None
    components = found.components if found else space.components[:0]
    cosines = np.sum(components * space.components[: len(components)], axis=1)
    turned = components * np.where(cosines < 0.0, -1.0, 1.0)[:, None]
    return TrainingInterval(
        start=tenth / INTERVALS,
        end=(tenth + 1) / INTERVALS,
        failures=len(rows),
        mean=mean.astype(np.float32),
        components=failures.by_step(turned).astype(np.float32),
        explained=(found.explained if found else np.zeros(0)).astype(np.float32),
        likeness=np.abs(cosines).astype(np.float32),
    )
