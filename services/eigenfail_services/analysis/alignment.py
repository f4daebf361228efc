"""Failures of different length, side by side."""

from collections.abc import Iterator, Sequence
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from eigenfail.values import AXES, Floats

BLOCK = 4096
"""How many rows are in double precision at a time."""


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
        return median_steps(steps)


ALIGNMENTS: dict[str, Alignment] = {"start": AtStart(), "collision": AtCollision()}

COLUMNS: dict[str, tuple[int, ...]] = {
    "joint": tuple(range(len(AXES))),
    **{axis: (column,) for column, axis in enumerate(AXES)},
}
"""Which axes of the noise each choice of `axes` analyses."""


def median_steps(steps: Sequence[int]) -> int:
    """The median length of some episodes; of two middle ones the longer."""
    return int(np.quantile(steps, 0.5, method="higher"))


class Aligned(NamedTuple):
    """Failures side by side.

    Attributes:
        campaigns: id of the campaign of each, shape (failures,).
        episodes: its index there, shape (failures,).
        steps: length of each, shape (failures,).
        noise: z, shape (failures, horizon, 2). [sigma]
        alignment: how they were put there.
        columns: the axes that are analysed.
    """

    campaigns: NDArray[np.int64]
    episodes: NDArray[np.int64]
    steps: NDArray[np.int64]
    noise: Floats
    alignment: Alignment
    columns: tuple[int, ...] = COLUMNS["joint"]

    @property
    def horizon(self) -> int:
        """Steps of a full episode."""
        return int(self.noise.shape[1])

    @property
    def data(self) -> Floats:
        """D: one row for each failure, shape (failures, horizon · axes)."""
        if self.columns == COLUMNS["joint"]:
            return self.noise.reshape(len(self.noise), -1)
        return np.ascontiguousarray(self.noise[:, :, self.columns]).reshape(len(self.noise), -1)

    @property
    def order(self) -> NDArray[np.intp]:
        """The rows by campaign and episode."""
        return np.lexsort((self.episodes, self.campaigns))

    def by_step(self, rows: NDArray[np.float64]) -> NDArray[np.float64]:
        """Rows like those of D, shape (rows, horizon, 2), zero along an axis that is left out."""
        placed = np.zeros((len(rows), self.horizon, len(AXES)))
        placed[:, :, self.columns] = rows.reshape(len(rows), self.horizon, len(self.columns))
        return placed

    def injectable(
        self, noise: NDArray[np.float64], members: NDArray[np.intp]
    ) -> NDArray[np.float64]:
        """Noise in the place of `members`, taken back to the start: z, both of (horizon, 2)."""
        steps = self.alignment.reference(self.steps[members].tolist(), self.horizon)
        z = np.zeros((self.horizon, len(AXES)))
        z[:steps] = noise[self.alignment.place(steps, self.horizon)]
        return z

    def at_collision(self) -> "Aligned":
        """The same failures, collision on collision."""
        there = ALIGNMENTS["collision"]
        if self.alignment is there:
            return self
        noise = np.zeros_like(self.noise)
        for row, z, steps in zip(noise, self.noise, self.steps.tolist(), strict=True):
            from_ = self.alignment.place(steps, self.horizon)
            row[there.place(steps, self.horizon)] = z[from_]
        return self._replace(noise=noise, alignment=there)

    def runs(self) -> Iterator[NDArray[np.float64]]:
        """The noise without what fills it up, in blocks of one length: (rows, its steps, 2)."""
        for steps in np.unique(self.steps).tolist():
            rows = np.flatnonzero(self.steps == steps)
            place = self.alignment.place(steps, self.horizon)
            for first in range(0, len(rows), BLOCK):
                yield self.noise[rows[first : first + BLOCK], place].astype(np.float64)
