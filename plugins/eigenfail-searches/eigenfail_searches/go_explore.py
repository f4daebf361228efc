"""Go-Explore: a tree search that returns to a state of an earlier episode and explores from there.

An episode is deterministic, so that its noise up to a step, given again, leads to the same state:
a return needs no saved state of the simulator, and works behind every bridge.
"""

from collections.abc import Iterator, Sequence
from math import ceil, isnan
from typing import Annotated, NamedTuple

import msgspec
import numpy as np
from msgspec import Meta

from eigenfail.contracts import MethodTraits
from eigenfail.errors import LearnerFailed
from eigenfail.values.arrays import Floats
from eigenfail.values.episode import EpisodeResult, Importance, Outcome, TrajectorySource
from eigenfail.values.learning import LearnerContext, Proposal, RoundSizes
from eigenfail_services.methods import archive

LARGEST_IMPORTANCE = 1e6
"""Importance beyond which all values are of one level."""


class GoExploreSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Settings of `go_explore`."""

    hold: Annotated[
        int,
        Meta(ge=1, le=10_000, description="steps for which a value is held, and of a time bin"),
    ] = 10
    scale: Annotated[
        float, Meta(gt=0.0, le=100.0, description="standard deviation of the values [sigma]")
    ] = 1.0
    importance: Annotated[
        Importance,
        Meta(
            description="what tells how close a step is to a collision: `required_braking`, "
            "`time_to_collision` or `distance`"
        ),
    ] = Importance.REQUIRED_BRAKING
    level_ratio: Annotated[
        float,
        Meta(
            ge=1.01,
            le=10.0,
            description="ratio of 1 + |importance| between the bounds of a level; a smaller one "
            "gives more cells",
        ),
    ] = 1.5
    round_size: Annotated[int, Meta(ge=1, le=10_000, description="episodes in a round")] = 20


class Cell(NamedTuple):
    """Key of a cell: states that count as alike.

    Attributes:
        decision: number of values of each channel that were held before the state.
        level: level of the importance of the step before the state; 0 at the start.
    """

    decision: int
    level: int


START = Cell(0, 0)


class CellRecord(msgspec.Struct):
    """The likeliest noise that led to a cell, and the number of visits.

    Attributes:
        visits: episodes that came into the cell while they explored, or returned to it.
        cost: sum of z² up to the state, of the likeliest way into the cell.
        noise: values of the episode that went this way, shape (decisions, channels). [sigma]
    """

    visits: int
    cost: float
    noise: Floats


class Exploration(NamedTuple):
    """An episode that was proposed: the cell that it returns to, and its values.

    Attributes:
        cell: where it begins to explore.
        noise: all of its values, shape (decisions, channels). [sigma]
    """

    cell: Cell
    noise: Floats


class LevelScale:
    """Bounds of the levels of importance: those of 1 + |importance| grow by a constant ratio.

    Args:
        ratio: above 1.
    """

    def __init__(self, ratio: float) -> None:
        # Products are the same on every processor, logarithms are not.
        bounds = [ratio]
        while bounds[-1] < LARGEST_IMPORTANCE:
            bounds.append(bounds[-1] * ratio)
        self._bounds = np.array(bounds)

    def find_level(self, importance: float) -> int:
        """Return the level of an importance: 0 from 0 on, below 0 of negative ones."""
        if isnan(importance):
            return 0
        level = int(np.searchsorted(self._bounds, 1.0 + abs(importance), side="right"))
        return level if importance >= 0.0 else -1 - level


class GoExplore:
    """Returns to cells by the noise that led there, and explores from there with random noise.

    A cell is chosen with a probability proportional to 1 / sqrt(visits + 1) (Ecoffet et al. 2021,
    Nature 590, 580, without a policy), and keeps the likeliest noise that led there, as in adaptive
    stress testing (Koren and Kochenderfer 2020, IEEE ITSC).

    Attributes:
        lookahead: 0, as each round depends on the cells of the one before.
    """

    Settings = GoExploreSettings

    class _Facts(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
        """Number of rounds that were proposed."""

        rounds: int

    traits = MethodTraits(needs_course=True, chart_mark=17, references={})
    lookahead = 0

    def __init__(self, context: LearnerContext, settings: GoExploreSettings) -> None:
        self._seed = context.seed
        self._horizon = context.horizon
        self._settings = settings
        self._shape = ceil(context.horizon / settings.hold), context.channels
        self._scale = LevelScale(settings.level_ratio)
        self._rounds = 0
        # In the order in which the cells were found, which the random choice depends on.
        self._cells = {START: CellRecord(0, 0.0, np.zeros(self._shape, np.float32))}
        self._open: list[Exploration] = []

    @staticmethod
    def round_sizes(settings: GoExploreSettings, _episodes: int) -> RoundSizes:
        """Return the size of all rounds."""
        return RoundSizes(settings.round_size, settings.round_size)

    def propose(self, n: int) -> Proposal:
        """Return a round of episodes, each of which returns to a cell that is chosen at random."""
        random = np.random.default_rng([self._seed, self._rounds])
        self._rounds += 1
        count = min(n, self._settings.round_size)
        weights = 1.0 / np.sqrt([one.visits + 1.0 for one in self._cells.values()])
        chosen = random.choice(len(weights), count, p=weights / weights.sum())
        values = self._settings.scale * random.standard_normal((count, *self._shape))
        cells = list(self._cells)
        self._open = [
            self._continue(cells[place], fresh.astype(np.float32))
            for place, fresh in zip(chosen.tolist(), values, strict=True)
        ]
        importance = self._settings.importance
        return Proposal(
            tuple(TrajectorySource(self._hold(one.noise), importance) for one in self._open)
        )

    def _continue(self, cell: Cell, fresh: Floats) -> Exploration:
        noise = self._cells[cell].noise
        return Exploration(cell, np.concatenate((noise[: cell.decision], fresh[cell.decision :])))

    def _hold(self, values: Floats) -> Floats:
        return np.repeat(values, self._settings.hold, axis=0)[: self._horizon]

    def observe(self, results: Sequence[EpisodeResult]) -> None:
        """Add the cells that the episodes came through after their return.

        Raises:
            LearnerFailed: an episode has no importance.
        """
        for exploration, result in zip(self._open, results, strict=True):
            # An episode that errored counts as well, or its cell would be chosen again and again.
            self._cells[exploration.cell].visits += 1
            if result.outcome is not Outcome.ERRORED:
                self._add(exploration, result)
        self._open = []

    def _add(self, exploration: Exploration, result: EpisodeResult) -> None:
        for cell, cost in self._trace(exploration.cell.decision, result):
            record = self._cells.get(cell)
            if record is None:
                self._cells[cell] = CellRecord(1, cost, exploration.noise)
                continue
            record.visits += 1
            if cost < record.cost:
                record.cost, record.noise = cost, exploration.noise

    def _trace(self, first: int, result: EpisodeResult) -> Iterator[tuple[Cell, float]]:
        """Yield the cells behind a decision, and the sum of z² up to each of them.

        The state after the last step is left out: nothing follows it.
        """
        if result.importance is None:
            raise LearnerFailed(
                f"Episode {result.index} came without the importance of its steps.",
                "Run workers of the same release as the controller.",
            )
        costs = np.cumsum(np.sum(result.noise.counted_z.astype(np.float64) ** 2, axis=1))
        for decision in range(first + 1, self._shape[0]):
            steps = decision * self._settings.hold
            if steps >= min(result.steps, len(result.importance)):
                return
            level = self._scale.find_level(float(result.importance[steps - 1]))
            yield Cell(decision, level), float(costs[steps - 1])

    def state(self) -> bytes:
        """Return a state with all cells, and the episodes whose results are not known yet."""
        noise, rows = _number_noise([one.noise for one in self._cells.values()])
        records = self._cells.values()
        arrays: dict[str, archive.Array] = {
            "cells": np.array(list(self._cells), np.int64),
            "visits": np.array([one.visits for one in records], np.int64),
            "costs": np.array([one.cost for one in records], np.float64),
            "rows": np.array(rows, np.int64),
            "noise": np.stack(noise),
            "open_cells": np.array([one.cell for one in self._open], np.int64).reshape(-1, 2),
            "open_noise": np.array([one.noise for one in self._open], np.float32).reshape(
                -1, *self._shape
            ),
        }
        return archive.write("go_explore", self._Facts(self._rounds), arrays)

    def restore(self, state: bytes) -> None:
        """Restore a state, from which the search goes on bit for bit.

        Raises:
            ProtocolError: the bytes are not a state of this method.
        """
        facts, arrays = archive.read("go_explore", state, self._Facts)
        with archive.wrap_errors("go_explore"):
            cells = self._read_cells(arrays)
            keys = archive.take(arrays, "open_cells", (len(arrays["open_cells"]), 2))
            noise = archive.take(arrays, "open_noise", (len(keys), *self._shape))
            opened = [
                Exploration(Cell(*key), values)
                for key, values in zip(keys.tolist(), noise, strict=True)
            ]
            if not all(one.cell in cells for one in opened):
                raise ValueError("an episode returns to a cell that is not there")
        self._rounds, self._cells, self._open = facts.rounds, cells, opened

    def _read_cells(self, arrays: archive.Arrays) -> dict[Cell, CellRecord]:
        # Cells of one row are to share one array, by which `state` knows that they do.
        noise = list(archive.take(arrays, "noise", (len(arrays["noise"]), *self._shape)))
        keys = archive.take(arrays, "cells", (len(arrays["cells"]), 2))
        visits, costs, rows = (
            archive.take(arrays, name, (len(keys),)).tolist()
            for name in ("visits", "costs", "rows")
        )
        if not all(0 <= row < len(noise) for row in rows):
            raise ValueError("a cell has noise that is not there")
        cells = {
            Cell(*key): CellRecord(count, cost, noise[row])
            for key, count, cost, row in zip(keys.tolist(), visits, costs, rows, strict=True)
        }
        if START not in cells:
            raise ValueError("there is no cell of the start")
        return cells


def _number_noise(noise: Sequence[Floats]) -> tuple[list[Floats], list[int]]:
    """Return each array once, and the number of each one's array; cells share episodes."""
    numbers: dict[int, int] = {}
    distinct: list[Floats] = []
    for one in noise:
        if id(one) not in numbers:
            numbers[id(one)] = len(distinct)
            distinct.append(one)
    return distinct, [numbers[id(one)] for one in noise]
