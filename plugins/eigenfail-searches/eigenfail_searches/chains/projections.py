"""Projections of chains of failures: numbers that show slow mixing."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from eigenfail.values.arrays import Floats
from eigenfail.values.disturbance import AXES

WINDOWS = 5
DIRECTIONS = 3
"""Principal components of the known failures that are watched."""

MOST_FAILURES = 1000
"""From which they are found."""

NEGLIGIBLE = 1e-6
"""Length of a direction, as a share of the longest one, below which there is none."""


def name_channels(channels: int) -> tuple[str, ...]:
    """Return what projections call the channels: the axes of a road, or numbers from 1 on.

    Chains do not know the names that a function gives to its channels; see `rename_channels`.
    """
    if channels == len(AXES):
        return AXES
    return tuple(f"channel {number}" for number in range(1, channels + 1))


def list_windows(channels: Sequence[str]) -> tuple[str, ...]:
    """Return the names of the projections that are means of the noise of one channel."""
    parts = range(1, WINDOWS + 1)
    return tuple(f"mean {name} noise in fifth {part}" for part in parts for name in channels)


def rename_channels(projections: Sequence[str], channels: Sequence[str]) -> tuple[str, ...]:
    """Return the names of projections with the names that a campaign gives to its channels."""
    known = list_windows(name_channels(len(channels)))
    renamed = dict(zip(known, list_windows(channels), strict=True))
    return tuple(renamed.get(name, name) for name in projections)


class WatchedDirections(NamedTuple):
    """Directions in the noise of known failures.

    Attributes:
        names: name of each direction.
        vectors: of unit length, shape (directions, steps · channels).
        channels: number of channels of the noise.
    """

    names: tuple[str, ...]
    vectors: NDArray[np.float64]
    channels: int

    def list_projections(self) -> tuple[str, ...]:
        """Return the names of all projections, in the order of `measure`."""
        windows = list_windows(name_channels(self.channels))
        return ("mean z²", "steps to the collision", "severity", *windows, *self.names)

    def measure(
        self, z: Floats, ends: NDArray[np.int64], severity: NDArray[np.float64]
    ) -> NDArray[np.float32]:
        """Return the projections of failures, shape (failures, projections).

        Noise after the end of an episode counts as 0, since it says nothing of the failure.

        Args:
            z: shape (failures, steps, channels).
            ends: number of steps of each episode.
            severity: of each failure; NaN if it is not known.
        """
        n, steps, channels = z.shape
        before = np.where(np.arange(steps)[:, None] < ends[:, None, None], z, 0.0)
        before = before.astype(np.float64)
        square = np.square(before).sum(axis=(1, 2)) / np.maximum(channels * ends, 1)
        windows = [part.sum(axis=1) for part in np.array_split(before, WINDOWS, axis=1)]
        along = before.reshape(n, -1) @ self.vectors.T
        columns = [square[:, None], ends[:, None], severity[:, None], *windows, along]
        return np.concatenate(columns, axis=1).astype(np.float32)


def find_directions(failures: Floats) -> WatchedDirections:
    """Return the mean noise of known failures and the principal components around it.

    Chains that started from these failures differ most in them before they mix.

    Args:
        failures: z of each, shape (n, steps, channels).
    """
    even = np.linspace(0, len(failures) - 1, min(len(failures), MOST_FAILURES)).astype(int)
    rows = failures[even].reshape(len(even), -1).astype(np.float64)
    mean = rows.mean(axis=0)
    components = np.linalg.svd(rows - mean, full_matrices=False)[2] if len(rows) > 1 else rows[:0]
    spread = np.linalg.norm((rows - mean) @ components[:DIRECTIONS].T, axis=0)
    longest = max(float(np.linalg.norm(rows)), 1.0)
    vectors = {"mean noise of the known failures": mean} | {
        f"component {i + 1} of the known failures": components[i]
        for i in np.flatnonzero(spread > NEGLIGIBLE * longest).tolist()
    }
    kept = {name: v for name, v in vectors.items() if np.linalg.norm(v) > NEGLIGIBLE}
    units = [v / np.linalg.norm(v) for v in kept.values()]
    stacked = np.array(units).reshape(len(units), rows.shape[1])
    return WatchedDirections(tuple(kept), stacked, failures.shape[2])
