"""Failure modes: what the failures of a cluster have in common, as noise that can be injected."""

import numpy as np
from numpy.typing import NDArray

from eigenfail.values import AXES, FailureMode, Floats
from eigenfail_services.analysis.alignment import Aligned
from eigenfail_services.analysis.components import ComponentSpace

BAND = (0.1, 0.9)


def modes(
    failures: Aligned, space: ComponentSpace, labels: NDArray[np.intp]
) -> tuple[FailureMode, ...]:
    """One mode for each label, in the order of the labels."""
    groups = (np.flatnonzero(labels == label) for label in range(labels.max() + 1))
    return tuple(mode(failures, space, members) for members in groups)


def mode(failures: Aligned, space: ComponentSpace, members: NDArray[np.intp]) -> FailureMode:
    """The mode of these failures: its centre, the real failure nearest to it, its eigenfailure.

    The eigenfailure is centre · V_k^T + mu (paper, inverse transform), taken back to the start.

    Args:
        failures: all of them.
        space: in which they are, row by row.
        members: the rows of these, shape (members,).
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
        band=band(failures, members),
    )


def band(failures: Aligned, members: NDArray[np.intp]) -> Floats:
    """How the noise of these failures spreads about their eigenfailure, shape (2, horizon, 2).

    At each step from the 10 % to the 90 % quantile over those that lasted so long, taken back to
    the start; zero where none did.
    """
    lasted = np.zeros((len(members), failures.horizon), np.bool_)
    for row, steps in zip(lasted, failures.steps[members].tolist(), strict=True):
        row[failures.alignment.place(steps, failures.horizon)] = True
    bounds = np.zeros((len(BAND), failures.horizon, len(AXES)))
    for step in np.flatnonzero(lasted.any(axis=0)):
        there = members[lasted[:, step]]
        bounds[:, step] = np.quantile(failures.noise[there, step].astype(np.float64), BAND, axis=0)
    return np.stack([failures.injectable(each, members) for each in bounds]).astype(np.float32)


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
