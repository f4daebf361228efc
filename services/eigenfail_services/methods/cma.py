"""CMA-ES over held noise: the standard black-box search for comparisons."""

from collections.abc import Sequence
from math import ceil, inf, isfinite
from typing import Annotated

import msgspec
import numpy as np
from msgspec import Meta

from eigenfail.contracts import MethodTraits
from eigenfail.errors import InvalidValue
from eigenfail.values.arrays import Floats
from eigenfail.values.episode import EpisodeResult, TrajectorySource
from eigenfail.values.learning import LearnerContext, Proposal, RoundSizes
from eigenfail_services.methods import Hold, UpToOne, UpToTen, archive, robustness_m
from eigenfail_services.methods.evolution import (
    Array,
    SearchDistribution,
    choose_rates,
    start_search,
)

MAX_COVARIANCE_NUMBERS = 1_000_000
"""Most numbers of the covariance matrices of all runs, which are part of each checkpoint."""


class CmaSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Settings of `cma`.

    First generations have a variance of 1 over all runs, like held noise. More runs find more
    regions. Fewer runs have more generations each, and then find likelier failures.
    """

    hold: Hold = 10
    runs: Annotated[
        int, Meta(ge=1, le=100, description="runs that take turns, each with its own start")
    ] = 5
    population: Annotated[
        int, Meta(ge=4, le=10_000, description="episodes in a generation of a run")
    ] = 12
    first_spread: Annotated[
        float,
        Meta(
            ge=0.0,
            le=10.0,
            description="standard deviation of the means that runs start from [sigma]",
        ),
    ] = 0.7
    first_step: Annotated[
        UpToTen, Meta(description="standard deviation of a run's first generation [sigma]")
    ] = 0.7
    max_std: Annotated[
        float,
        Meta(ge=0.1, le=100.0, description="largest standard deviation of a generation [sigma]"),
    ] = 1.0
    converged: Annotated[
        UpToOne,
        Meta(description="a run starts anew once its largest standard deviation is less [sigma]"),
    ] = 0.05
    failing_share: Annotated[
        float,
        Meta(
            ge=0.0,
            le=1.0,
            description="share of a generation that is to fail: with less its failures rank equal",
        ),
    ] = 0.0


class Score(msgspec.Struct, frozen=True, order=True):
    """Score of a candidate: robustness, then likelihood; the smallest score is the best.

    Attributes:
        robustness_m: 0 for a failure, infinite for an errored episode. [m]
        squares: sum of z² over the steps of the episode, which is -2 log p up to a constant.
    """

    robustness_m: float
    squares: float


def score_episode(result: EpisodeResult) -> Score:
    """Return the score of an episode; its noise counts as injected, up to its end."""
    robustness = robustness_m(result)
    if not isfinite(robustness):
        return Score(inf, inf)
    z = result.noise.counted_z.astype(np.float64)
    return Score(robustness, float(np.sum(z**2)))


def level_failures(scores: list[Score], share: float) -> list[Score]:
    """Return scores that rank failures equal if less than a share of the candidates failed.

    The likeliest failures lie on the border of their region, and only half of a generation around
    them fails. If failures rank equal, they pull the mean to their middle, away from the border.
    """
    if sum(score.robustness_m == 0.0 for score in scores) >= share * len(scores):
        return scores
    return [Score(0.0, 0.0) if score.robustness_m == 0.0 else score for score in scores]


class EvolutionRun:
    """A run: distribution and scores of its present generation; it restarts when it converges.

    Its random draws depend only on the seed, the number of the run and the number of the draw.

    Attributes:
        distribution: distribution of the present generation.
        draw: number of the draw of the present generation, over all starts.
        proposed: number of taken candidates of the present generation.
        scores: scores of the first candidates of the present generation.
    """

    def __init__(self, seed: tuple[int, int], dimension: int, settings: CmaSettings) -> None:
        self._seed = seed
        self._dimension = dimension
        self._settings = settings
        self._rates = choose_rates(dimension, settings.population)
        self.draw = 0
        self.proposed = 0
        self.scores: list[Score] = []
        self.distribution = self._draw_first_distribution()
        self._candidates = self._draw_candidates()

    def take_candidates(self, n: int) -> Array:
        """Return the next candidates of the generation, shape (up to n, dimension)."""
        taken = self._candidates[self.proposed : self.proposed + n]
        self.proposed += len(taken)
        return taken

    def add(self, scores: Sequence[Score]) -> None:
        """Add the scores of the next candidates, and adapt after a generation's last one."""
        self.scores += scores
        if len(self.scores) == self._settings.population:
            self._finish_generation()

    def restore(
        self, distribution: SearchDistribution, draw: int, proposed: int, scores: list[Score]
    ) -> None:
        """Continue from a distribution, a draw and the scores so far."""
        self.distribution, self.draw = distribution, draw
        self.proposed, self.scores = proposed, scores
        self._candidates = self._draw_candidates()

    def _finish_generation(self) -> None:
        scores = level_failures(self.scores, self._settings.failing_share)
        # Ties, such as failures that rank equal, stay in the order of their draw: `sorted` is
        # stable.
        order = sorted(range(len(scores)), key=scores.__getitem__)
        self.draw += 1
        # A generation in which no episode could be run has no information: it is drawn again.
        if isfinite(scores[order[0]].robustness_m):
            self.distribution = self.distribution.adapt(self._candidates[order], self._rates)
            deviation = self.distribution.find_largest_deviation()
            # Noise has a standard deviation of 1. Without a limit the strategy takes ever larger
            # steps towards a distant failure, and the first failures are far beyond the likeliest.
            if deviation > self._settings.max_std:
                self.distribution = self.distribution.narrow(self._settings.max_std / deviation)
            elif deviation < self._settings.converged:
                self.distribution = self._draw_first_distribution()
        self.proposed, self.scores = 0, []
        self._candidates = self._draw_candidates()

    def _draw_first_distribution(self) -> SearchDistribution:
        normals = self._random(START).standard_normal(self._dimension)
        return start_search(self._settings.first_spread * normals, self._settings.first_step)

    def _draw_candidates(self) -> Array:
        shape = self._settings.population, self._dimension
        return self.distribution.transform(self._random(GENERATION).standard_normal(shape))

    def _random(self, purpose: int) -> np.random.Generator:
        return np.random.default_rng([*self._seed, self.draw, purpose])


START, GENERATION = 1, 2
"""What numbers are drawn for, as part of their seed."""


class CovarianceAdaptation:
    """Adapts normal distributions to episodes, ranked by robustness and failures by likelihood.

    A candidate has one value per channel for each period of `hold` steps. Several runs take turns,
    with a generation each. So several regions are found, and workers do not wait, because runs are
    independent.

    Attributes:
        lookahead: one less than the number of runs.

    Raises:
        InvalidValue: there are too many values for a covariance matrix per run.
    """

    Settings = CmaSettings

    class _Facts(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
        """Numbers of proposed and observed rounds."""

        proposed: int
        observed: int

    traits = MethodTraits(chart_mark=10, references={})
    lookahead = CmaSettings().runs - 1

    def __init__(self, context: LearnerContext, settings: CmaSettings) -> None:
        dimension = context.channels * ceil(context.horizon / settings.hold)
        check_size(dimension, settings)
        self.lookahead = settings.runs - 1
        self._horizon = context.horizon
        self._channels = context.channels
        self._settings = settings
        self._facts = self._Facts(0, 0)
        self._runs = [
            EvolutionRun((context.seed, number), dimension, settings)
            for number in range(settings.runs)
        ]

    @staticmethod
    def round_sizes(settings: CmaSettings, _episodes: int) -> RoundSizes:
        """Return the size of a generation for all rounds."""
        return RoundSizes(settings.population, settings.population, "population")

    def propose(self, n: int) -> Proposal:
        """Return the rest of the generation of the run whose turn it is."""
        run = self._runs[self._facts.proposed % len(self._runs)]
        self._facts = self._Facts(self._facts.proposed + 1, self._facts.observed)
        return Proposal(tuple(TrajectorySource(self._hold(x)) for x in run.take_candidates(n)))

    def _hold(self, candidate: Array) -> Floats:
        knots = candidate.reshape(-1, self._channels).astype(np.float32)
        # The last value is cut where the horizon is not a multiple of `hold`.
        return np.repeat(knots, self._settings.hold, axis=0)[: self._horizon]

    def observe(self, results: Sequence[EpisodeResult]) -> None:
        """Add the scores of a round to its run."""
        # Rounds are observed in the order in which they were proposed: the turn says whose they
        # are.
        run = self._runs[self._facts.observed % len(self._runs)]
        self._facts = self._Facts(self._facts.proposed, self._facts.observed + 1)
        run.add([score_episode(result) for result in results])

    def state(self) -> bytes:
        """Return a state with the distributions of all runs and the scores of open generations."""
        each = [run.distribution for run in self._runs]
        scores = np.zeros((len(self._runs), self._settings.population, 2))
        for row, run in zip(scores, self._runs, strict=True):
            for place, score in enumerate(run.scores):
                row[place] = score.robustness_m, score.squares
        counts = [
            (run.distribution.generation, run.draw, run.proposed, len(run.scores))
            for run in self._runs
        ]
        arrays = {
            "mean": np.stack([one.mean for one in each]),
            "step": np.array([one.step for one in each]),
            "covariance": np.stack([one.covariance for one in each]),
            "path_sigma": np.stack([one.path_sigma for one in each]),
            "path_c": np.stack([one.path_c for one in each]),
            "counts": np.array(counts, np.int64),
            "scores": scores,
        }
        return archive.write("cma", self._facts, arrays)

    def restore(self, state: bytes) -> None:
        """Restore a state, so that learning continues bit for bit.

        Raises:
            ProtocolError: the bytes are not a state of this method.
        """
        facts, arrays = archive.read("cma", state, self._Facts)
        runs, dimension = len(self._runs), len(self._runs[0].distribution.mean)
        with archive.wrap_errors("cma"):
            mean, path_sigma, path_c = (
                archive.take(arrays, name, (runs, dimension))
                for name in ("mean", "path_sigma", "path_c")
            )
            step = archive.take(arrays, "step", (runs,)).tolist()
            covariance = archive.take(arrays, "covariance", (runs, dimension, dimension))
            counts = archive.take(arrays, "counts", (runs, 4)).tolist()
            scores = archive.take(arrays, "scores", (runs, self._settings.population, 2)).tolist()
            for _, draw, proposed, scored in counts:
                if draw < 0 or not 0 <= scored <= proposed <= self._settings.population:
                    raise ValueError(f"a run has {scored} scores of {proposed} candidates")
        self._facts = facts
        for i, run in enumerate(self._runs):
            generation, draw, proposed, scored = counts[i]
            run.restore(
                SearchDistribution(
                    mean[i], step[i], covariance[i], path_sigma[i], path_c[i], generation
                ),
                draw,
                proposed,
                [Score(*pair) for pair in scores[i][:scored]],
            )


def check_size(dimension: int, settings: CmaSettings) -> None:
    """Raise InvalidValue if the covariance matrices of all runs would be too large."""
    numbers = settings.runs * dimension**2
    if numbers > MAX_COVARIANCE_NUMBERS:
        raise InvalidValue(
            "settings.hold",
            f"{settings.hold} steps give {dimension} values of noise, and the covariance matrices "
            f"of {settings.runs} runs {numbers:,} numbers; the limit is "
            f"{MAX_COVARIANCE_NUMBERS:,}.",
            "Hold values for more steps, or take fewer runs.",
        )
