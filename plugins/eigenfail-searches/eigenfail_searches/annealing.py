"""Simulated annealing over noise that is held: random walks that accept ever fewer steps backwards.

With a scale of 1 the walk is reversible with respect to N(0, 1), so that likelihood needs no term
of the energy: at a constant temperature T it samples p(z) exp(-robustness / T) of held noise.
"""

from collections.abc import Sequence
from math import ceil, exp, isfinite, sqrt
from typing import Annotated

import msgspec
import numpy as np
from numpy.typing import NDArray

from eigenfail.contracts import MethodTraits
from eigenfail.values.arrays import Floats
from eigenfail.values.episode import EpisodeResult, TrajectorySource
from eigenfail.values.learning import LearnerContext, Proposal, RoundSizes
from eigenfail_services.methods import Hold, archive, robustness_m

Array = NDArray[np.float64]

COOLED = 0.01
"""Share of the first temperature that is left after `cooling` moves; it goes on falling."""

LARGEST_RISE = 700.0
"""Rise of robustness ÷ temperature beyond which the exponential is 0 in double precision."""

ACCEPTANCE = 1
"""Part of the seed of the numbers that decide whether moves are accepted; that of moves has a 0."""

MIN_STEP, FIRST_STEP = 0.01, 0.5
ADAPTATION, ADAPTATION_FAILED = 0.1, 0.5
"""Change of the logarithm of a step's length, per unit of accepted moves above the target, of a run
that has not failed and of one that has. A step that shrinks fast would not reach a failure."""


class AnnealingSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Settings of `annealing`.

    A larger acceptance gives shorter moves: more of the episodes fail once a run has found a
    failure, and they differ less.
    """

    hold: Hold = 10
    scale: Annotated[
        float,
        msgspec.Meta(
            gt=0.0,
            le=100.0,
            description="standard deviation of first noise and of moves [sigma]",
        ),
    ] = 1.0
    runs: Annotated[
        int,
        msgspec.Meta(ge=1, le=1_000, description="independent runs, each with a move in a round"),
    ] = 5
    temperature: Annotated[
        float,
        msgspec.Meta(
            gt=0.0,
            le=100.0,
            description="first temperature, as a share of the robustness of the first episode",
        ),
    ] = 0.1
    cooling: Annotated[
        int,
        msgspec.Meta(
            ge=1,
            le=100_000,
            description="moves in which the temperature falls to a hundredth of the first one",
        ),
    ] = 40
    acceptance: Annotated[
        float,
        msgspec.Meta(
            ge=0.05,
            le=0.995,
            description="share of moves to accept, which the length of moves follows",
        ),
    ] = 0.7
    restart: Annotated[
        int,
        msgspec.Meta(ge=1, le=100_000, description="failures of a run after which it starts anew"),
    ] = 100


class Walk(msgspec.Struct):
    """Where a run is.

    Attributes:
        point: the last accepted candidate, shape (dimension,). [sigma]
        robustness_m: its robustness; infinite before the first episode. [m]
        first_m: robustness of the first episode since the start; 0 before it. [m]
        step: β of the next move, in (0, 1].
        moves: moves since the start.
        failures: failures since the start.
        draws: candidates that were judged, over all starts: part of the seed of the next one.
    """

    point: Array
    robustness_m: float = np.inf
    first_m: float = 0.0
    step: float = FIRST_STEP
    moves: int = 0
    failures: int = 0
    draws: int = 0


class SimulatedAnnealing:
    """Several runs of simulated annealing, which move in turn and start anew after many failures.

    The moves are those of the preconditioned Crank-Nicolson walk, z' = sqrt(1 - β²) z + β ξ (Cotter
    et al. 2013, Statistical Science 28, 424); the temperature falls geometrically (Kirkpatrick,
    Gelatt, Vecchi 1983, Science 220, 671). An episode that could not be run is never accepted.
    """

    Settings = AnnealingSettings

    class _Facts(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
        """Numbers of moves, failures and draws of each run."""

        counts: tuple[tuple[int, int, int], ...]

    traits = MethodTraits(chart_mark=15, references={})
    lookahead = 0

    def __init__(self, context: LearnerContext, settings: AnnealingSettings) -> None:
        self._seed = context.seed
        self._horizon = context.horizon
        self._channels = context.channels
        self._settings = settings
        dimension = context.channels * ceil(context.horizon / settings.hold)
        self._walks = [Walk(np.zeros(dimension)) for _ in range(settings.runs)]

    @staticmethod
    def round_sizes(settings: AnnealingSettings, _episodes: int) -> RoundSizes:
        """Return the number of runs for all rounds."""
        return RoundSizes(settings.runs, settings.runs, "runs")

    def propose(self, n: int) -> Proposal:
        """Return the next move of each run, of the first n if there are more."""
        count = min(n, len(self._walks))
        return Proposal(tuple(TrajectorySource(self._hold(i)) for i in range(count)))

    def _hold(self, run: int) -> Floats:
        knots = self._find_candidate(run).reshape(-1, self._channels).astype(np.float32)
        return np.repeat(knots, self._settings.hold, axis=0)[: self._horizon]

    def _find_candidate(self, run: int) -> Array:
        walk = self._walks[run]
        normals = self._settings.scale * self._random(run).standard_normal(len(walk.point))
        if not walk.moves:
            return normals
        candidate: Array = sqrt(1.0 - walk.step**2) * walk.point + walk.step * normals
        return candidate

    def _random(self, run: int, purpose: int = 0) -> np.random.Generator:
        return np.random.default_rng([self._seed, run, self._walks[run].draws, purpose])

    def observe(self, results: Sequence[EpisodeResult]) -> None:
        """Accept or refuse the move of each run."""
        for run, result in enumerate(results):
            robustness = robustness_m(result)
            if isfinite(robustness):
                self._judge(run, robustness)
            self._walks[run].draws += 1

    def _judge(self, run: int, robustness: float) -> None:
        walk = self._walks[run]
        if not walk.moves:
            walk.first_m = robustness
        accepted = self._random(run, ACCEPTANCE).random() < self._find_chance(walk, robustness)
        if accepted:
            walk.point, walk.robustness_m = self._find_candidate(run), robustness
        # The share of accepted moves settles at `acceptance` (Robbins and Monro 1951).
        rate = ADAPTATION if walk.robustness_m else ADAPTATION_FAILED
        change = rate * (float(accepted) - self._settings.acceptance)
        walk.step = min(max(walk.step * exp(change), MIN_STEP), 1.0)
        walk.moves += 1
        walk.failures += robustness == 0.0
        # So short a step leaves no local minimum.
        stuck = walk.robustness_m > 0.0 and walk.step <= MIN_STEP
        if stuck or walk.failures >= self._settings.restart:
            self._walks[run] = Walk(np.zeros(len(walk.point)), draws=walk.draws)

    def _find_chance(self, walk: Walk, robustness: float) -> float:
        if robustness <= walk.robustness_m:
            return 1.0
        share = COOLED ** (walk.moves / self._settings.cooling)
        temperature = self._settings.temperature * walk.first_m * share
        # A quotient of this size has no chance; the temperature itself may round to 0.
        rise = robustness - walk.robustness_m
        return exp(-rise / temperature) if rise < LARGEST_RISE * temperature else 0.0

    def state(self) -> bytes:
        """Return a state with the points of all runs."""
        counts = tuple((one.moves, one.failures, one.draws) for one in self._walks)
        numbers = [(one.robustness_m, one.first_m, one.step) for one in self._walks]
        points = np.stack([one.point for one in self._walks]).astype(np.float64)
        return archive.write(
            "annealing", self._Facts(counts), {"points": points, "numbers": np.array(numbers)}
        )

    def restore(self, state: bytes) -> None:
        """Restore a state, from which the search goes on bit for bit.

        Raises:
            ProtocolError: the bytes are not a state of this method.
        """
        facts, arrays = archive.read("annealing", state, self._Facts)
        shape = len(self._walks), len(self._walks[0].point)
        with archive.wrap_errors("annealing"):
            points = archive.take(arrays, "points", shape)
            numbers = archive.take(arrays, "numbers", (len(self._walks), 3)).tolist()
            if len(facts.counts) != len(self._walks):
                raise ValueError(f"there are {len(facts.counts)} runs")
        rows = zip(points, numbers, facts.counts, strict=True)
        self._walks = [
            Walk(point, robustness_m, first_m, step, moves, failures, draws)
            for point, (robustness_m, first_m, step), (moves, failures, draws) in rows
        ]
