"""Failure modes: what the failures of a cluster have in common, as noise that can be injected."""

import numpy as np
from numpy.typing import NDArray

from eigenfail.values import FailureMode
from eigenfail_services.analysis.alignment import Aligned
from eigenfail_services.analysis.components import ComponentSpace


def modes(
    failures: Aligned, space: ComponentSpace, labels: NDArray[np.intp]
) -> tuple[FailureMode, ...]:
    """One mode for each label, in the order of the labels."""
    groups = (np.flatnonzero(labels == label) for label in range(labels.max() + 1))
    return tuple(mode(failures, space, members) for members in groups)


def mode(failures: Aligned, space: ComponentSpace, members: NDArray[np.intp]) -> FailureMode:
    """The mode of these failures: its centre, the real failure nearest to it, its eigenfailure.

    The eigenfailure is centre · V_k^T + mu (paper, inverse transform), taken back to the start.
    """
    scores = space.scores[members]
    centre = scores.mean(axis=0)
    nearest = members[np.argmin(np.linalg.norm(scores - centre, axis=1))]
    eigenfailure = failures.injectable(noise_at(centre, failures, space, members), members)
    return FailureMode(
        failures=len(members),
        medoid=int(failures.episodes[nearest]),
        centre=centre.astype(np.float32),
        eigenfailure=eigenfailure.astype(np.float32),
        medoid_campaign=int(failures.campaigns[nearest]),
    )


def noise_at(
    centre: NDArray[np.float64],
    failures: Aligned,
    space: ComponentSpace,
    members: NDArray[np.intp],
) -> NDArray[np.float64]:
    """The noise of a centre, shape (horizon, 2); along an axis left out, its failures' mean.

    A planner fails by both axes together: without any noise along one of them it might not.
    """
    noise = np.asarray(failures.noise[members].mean(axis=0, dtype=np.float64))
    noise[:, failures.columns] = space.invert(centre).reshape(failures.horizon, -1)
    return noise
