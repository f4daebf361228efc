"""Failures of different length, side by side."""

from collections.abc import Sequence
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from eigenfail.values.records import Failures


class Alignment(Protocol):
    """Where an episode stands within the horizon."""

    def place(self, steps: int, horizon: int) -> slice:
        """The rows that an episode of so many steps fills; the others hold no noise."""

    def reference(self, steps: Sequence[int], horizon: int) -> int:
        """The number of steps that stands for all of these episodes."""


class AtStart:
    """First step on first step; after the collision no noise is injected."""

    def place(self, steps: int, _horizon: int) -> slice:
        """From the first row on."""
        return slice(0, steps)

    def reference(self, _steps: Sequence[int], horizon: int) -> int:
        """The horizon: nothing moves on the way back."""
        return horizon


class AtCollision:
    """Collision on collision: a row is a time before the impact."""

    def place(self, steps: int, horizon: int) -> slice:
        """Up to the last row."""
        return slice(horizon - steps, horizon)

    def reference(self, steps: Sequence[int], _horizon: int) -> int:
        """The median, and of two middle ones the longer: the impact comes when it usually did."""
        return int(np.quantile(steps, 0.5, method="higher"))


ALIGNMENTS: dict[str, Alignment] = {"start": AtStart(), "collision": AtCollision()}


class Aligned(NamedTuple):
    """Failures side by side.

    Attributes:
        episodes: index of each, shape (failures,).
        steps: length of each, shape (failures,).
        noise: z, shape (failures, horizon, 2). [sigma]
        alignment: how they were put there.
    """

    episodes: NDArray[np.int64]
    steps: NDArray[np.int64]
    noise: NDArray[np.float64]
    alignment: Alignment

    @property
    def data(self) -> NDArray[np.float64]:
        """D: one row for each failure, shape (failures, 2 · horizon)."""
        return self.noise.reshape(len(self.noise), -1)

    def injectable(
        self, row: NDArray[np.float64], members: NDArray[np.intp]
    ) -> NDArray[np.float64]:
        """A row in the place of `members`, taken back to the start: z, shape (horizon, 2)."""
        horizon = self.noise.shape[1]
        steps = self.alignment.reference(self.steps[members].tolist(), horizon)
        z = np.zeros((horizon, 2))
        z[:steps] = row.reshape(horizon, 2)[self.alignment.place(steps, horizon)]
        return z


def align(failures: Failures, horizon: int, how: str) -> Aligned:
    """Put failures side by side.

    Args:
        failures: none longer than the horizon.
        horizon: steps of a full episode.
        how: a name in `ALIGNMENTS`.
    """
    alignment = ALIGNMENTS[how]
    noise = np.zeros((len(failures.noise), horizon, 2))
    for row, z in zip(noise, failures.noise, strict=True):
        row[alignment.place(len(z), horizon)] = z
    steps = [len(z) for z in failures.noise]
    return Aligned(np.array(failures.indices), np.array(steps), noise, alignment)
