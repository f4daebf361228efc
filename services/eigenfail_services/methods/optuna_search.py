"""Samplers of Optuna over noise that is held: the black-box optimisers that users compare with.

Optuna (Akiba et al. 2019, KDD, 2623) is the extra `optuna` of the package. Its CMA-ES is left out:
its state is a pickled object, and `cma` is the same strategy.
"""

from collections.abc import Callable, Sequence
from importlib.util import find_spec
from math import ceil, isfinite, nan
from typing import TYPE_CHECKING, Annotated, Literal

import msgspec
import numpy as np
from numpy.typing import NDArray

from eigenfail.contracts import MethodTraits
from eigenfail.errors import InvalidValue
from eigenfail.values import (
    EpisodeResult,
    Floats,
    LearnerContext,
    Proposal,
    RoundSizes,
    TrajectorySource,
)
from eigenfail_services.methods import archive, robustness_m

if TYPE_CHECKING:
    import optuna
    from optuna.samplers import BaseSampler

Array = NDArray[np.float64]

Sampler = Literal["tpe", "gp", "nsga2"]

MAX_GP_EPISODES = 500
"""Most episodes with `gp`, whose time for a proposal grows with their cube."""

GENERATION = "NSGAIISampler:generation"
"""Name under which Optuna keeps the generation of a trial."""


class OptunaSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Settings of `optuna`.

    `tpe` (tree-structured Parzen estimator) and `gp` (Gaussian process) minimise the robustness,
    and among failures the mean of z². `nsga2` looks for the Pareto front of both; where a campaign
    has several requirements, of the robustness of each and of the mean of z².
    """

    sampler: Annotated[
        Sampler, msgspec.Meta(description="`tpe`, `gp` (at most 500 episodes) or `nsga2`")
    ] = "tpe"
    hold: Annotated[
        int, msgspec.Meta(ge=1, le=10_000, description="steps for which a value is held")
    ] = 10
    amplitude: Annotated[
        float, msgspec.Meta(gt=0.0, le=10.0, description="bound of the values [sigma]")
    ] = 2.0
    round_size: Annotated[
        int,
        msgspec.Meta(ge=2, le=10_000, description="episodes in a round; of `nsga2` a generation"),
    ] = 10

    def check_budget(self, episodes: int) -> None:
        """Raise InvalidValue without Optuna, or for more episodes than `gp` can serve."""
        if find_spec("optuna") is None:
            raise InvalidValue(
                "method",
                "`optuna` needs the package optuna, which the service does not find.",
                "Install it where the service runs: pip install 'eigenfail[optuna]'",
            )
        if self.sampler == "gp" and episodes > MAX_GP_EPISODES:
            raise InvalidValue(
                "episodes",
                f"{episodes} episodes are too many for `gp`, the limit is {MAX_GP_EPISODES}.",
                "Take the sampler `tpe`, or fewer episodes.",
            )

    def reach(self) -> str:
        """Return the largest disturbance that the method can choose, and how to go beyond it."""
        return (
            f"`optuna` chooses noise within ±{self.amplitude:g} sigma; a larger "
            "`settings.amplitude` reaches further."
        )


def score_single(result: EpisodeResult) -> tuple[float, ...]:
    """Return the robustness [m]; below 0 for a failure, the less the likelier its noise."""
    robustness = robustness_m(result)
    return (robustness if robustness > 0.0 else -1.0 / (1.0 + find_mean_square(result)),)


def score_several(result: EpisodeResult) -> tuple[float, ...]:
    """Return the robustness of each requirement, in its unit, and the mean of z²."""
    found = result.requirements or (robustness_m(result),)
    return (*(max(each, 0.0) for each in found), find_mean_square(result))


def find_mean_square(result: EpisodeResult) -> float:
    """Return the mean of z² over steps and channels, up to the end of the episode. [sigma²]"""
    return float(np.mean(result.noise.counted_z.astype(np.float64) ** 2))


def find_scores(sampler: Sampler, result: EpisodeResult) -> tuple[float, ...] | None:
    """Return what a sampler minimises; None of an episode that could not be run."""
    return SCORES[sampler](result) if isfinite(robustness_m(result)) else None


SCORES: dict[Sampler, Callable[[EpisodeResult], tuple[float, ...]]] = {
    "tpe": score_single,
    "gp": score_single,
    "nsga2": score_several,
}


class OptunaSearch:
    """Asks a sampler of Optuna for the noise of each episode, and tells it the robustness.

    All episodes of a round are asked for before the results of the first are told. The sampler is
    made anew for each round, with a seed of its own: what it proposes depends on the episodes so
    far, on the seed and on the number of the round alone, so that a study is restored from numbers.
    The first round is drawn uniformly, since its results tell how many objectives there are.
    """

    Settings = OptunaSettings

    class _Facts(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
        """Number of rounds that were proposed."""

        rounds: int

    traits = MethodTraits(chart_mark=16, references={})
    lookahead = 0

    def __init__(self, context: LearnerContext, settings: OptunaSettings) -> None:
        self._seed = context.seed
        self._horizon = context.horizon
        self._channels = context.channels
        self._settings = settings
        self._rounds = 0
        self._first: list[Array] = []
        self._study: optuna.Study | None = None
        self._dimension = context.channels * ceil(context.horizon / settings.hold)

    @staticmethod
    def round_sizes(settings: OptunaSettings, _episodes: int) -> RoundSizes:
        """Return the size of all rounds."""
        return RoundSizes(settings.round_size, settings.round_size, "round_size")

    def propose(self, n: int) -> Proposal:
        """Return a round of noise that the sampler asks for."""
        count = min(n, self._settings.round_size)
        seeds = np.random.SeedSequence([self._seed, self._rounds])
        self._rounds += 1
        if self._study is None:
            candidates = self._draw_first(count, seeds)
        else:
            candidates = self._ask(self._study, count, seeds)
        return Proposal(tuple(TrajectorySource(self._hold(each)) for each in candidates))

    def _draw_first(self, count: int, seeds: np.random.SeedSequence) -> list[Array]:
        bound = self._settings.amplitude
        shape = count, self._dimension
        self._first = list(np.random.default_rng(seeds).uniform(-bound, bound, shape))
        return self._first

    def _ask(self, study: "optuna.Study", count: int, seeds: np.random.SeedSequence) -> list[Array]:
        study.sampler = make_sampler(self._settings, int(seeds.generate_state(1)[0]))
        distributions = make_distributions(self._dimension, self._settings.amplitude)
        trials = [study.ask(distributions) for _ in range(count)]
        return [np.array(list(trial.params.values())) for trial in trials]

    def _hold(self, candidate: Array) -> Floats:
        knots = candidate.reshape(-1, self._channels).astype(np.float32)
        return np.repeat(knots, self._settings.hold, axis=0)[: self._horizon]

    def observe(self, results: Sequence[EpisodeResult]) -> None:
        """Tell the sampler the scores of a round; episodes that could not be run have failed."""
        scores = [find_scores(self._settings.sampler, result) for result in results]
        if self._study is None:
            self._begin_study(scores)
            return
        asked = self._study.get_trials(deepcopy=False)[-len(results) :]
        for trial, score in zip(asked, scores, strict=True):
            if score is None:
                self._study.tell(trial.number, state=trial.state.FAIL)
            else:
                self._study.tell(trial.number, score)

    def _begin_study(self, scores: Sequence[tuple[float, ...] | None]) -> None:
        found = [(x, each) for x, each in zip(self._first, scores, strict=True) if each]
        self._first = []
        if found:
            trials = TrialTable(
                points=np.stack([x for x, _ in found]),
                values=np.array([each for _, each in found]),
                generations=np.zeros(len(found), np.int64),
                states=np.ones(len(found), np.int64),
            )
            self._study = create_study(trials, self._settings.amplitude)

    def state(self) -> bytes:
        """Return a state with all trials of the study, or the first round before there is one."""
        facts = self._Facts(self._rounds)
        if self._study is None:
            first = np.reshape(self._first, (-1, self._dimension)).astype(np.float64)
            return archive.write("optuna", facts, {"first": first})
        return archive.write("optuna", facts, msgspec.structs.asdict(list_trials(self._study)))

    def restore(self, state: bytes) -> None:
        """Restore a state, from which the sampler goes on with the same proposals.

        Raises:
            ProtocolError: the bytes are not a state of this method.
        """
        facts, arrays = archive.read("optuna", state, self._Facts)
        with archive.wrap_errors("optuna"):
            if "first" in arrays:
                n = len(arrays["first"])
                first = list(archive.take(arrays, "first", (n, self._dimension)))
                study = None
            else:
                first, (n, objectives) = [], arrays["values"].shape
                trials = TrialTable(
                    points=archive.take(arrays, "points", (n, self._dimension)),
                    values=archive.take(arrays, "values", (n, objectives)),
                    generations=archive.take(arrays, "generations", (n,)),
                    states=archive.take(arrays, "states", (n,)),
                )
                study = create_study(trials, self._settings.amplitude)
        self._rounds, self._first, self._study = facts.rounds, first, study


class TrialTable(msgspec.Struct, frozen=True, eq=False):
    """The trials of a study, in their order.

    Attributes:
        points: noise that was asked for, shape (n, dimension). [sigma]
        values: objectives, shape (n, objectives); NaN where none was told.
        generations: generation of each trial under `nsga2`, shape (n,); -1 of other samplers.
        states: number of the state that Optuna gives each trial, shape (n,).
    """

    points: Array
    values: Array
    generations: NDArray[np.int64]
    states: NDArray[np.int64]


def list_trials(study: "optuna.Study") -> TrialTable:
    """Return the trials of a study."""
    trials = study.get_trials(deepcopy=False)
    nothing = [nan] * len(study.directions)
    return TrialTable(
        points=np.array([list(each.params.values()) for each in trials]),
        values=np.array([each.values or nothing for each in trials]),
        generations=np.array([each.system_attrs.get(GENERATION, -1) for each in trials]),
        states=np.array([int(each.state) for each in trials]),
    )


def create_study(trials: TrialTable, amplitude: float) -> "optuna.Study":
    """Return a study in memory with the given trials."""
    import optuna

    # Optuna tells of each study and of each trial on standard error.
    optuna.logging.set_verbosity(optuna.logging.ERROR)
    dimension, objectives = trials.points.shape[1], trials.values.shape[1]
    study = optuna.create_study(directions=["minimize"] * objectives)
    distributions = make_distributions(dimension, amplitude)
    rows = zip(trials.points, trials.values, trials.generations, trials.states, strict=True)
    for point, values, generation, state in rows:
        study.add_trial(
            optuna.trial.create_trial(
                state=optuna.trial.TrialState(int(state)),
                values=None if np.isnan(values).any() else values.tolist(),
                params=dict(zip(distributions, point.tolist(), strict=True)),
                distributions=distributions,
                system_attrs={} if generation < 0 else {GENERATION: int(generation)},
            )
        )
    return study


def make_distributions(
    dimension: int, amplitude: float
) -> "dict[str, optuna.distributions.BaseDistribution]":
    """Return the range of each value of the noise, by its name."""
    import optuna

    between = optuna.distributions.FloatDistribution(-amplitude, amplitude)
    return {f"z{i}": between for i in range(dimension)}


def make_sampler(settings: OptunaSettings, seed: int) -> "BaseSampler":
    """Return a new sampler."""
    import optuna

    makers: dict[Sampler, Callable[[], BaseSampler]] = {
        "tpe": lambda: optuna.samplers.TPESampler(seed=seed),
        "gp": lambda: optuna.samplers.GPSampler(seed=seed),
        "nsga2": lambda: optuna.samplers.NSGAIISampler(
            seed=seed, population_size=settings.round_size
        ),
    }
    return makers[settings.sampler]()
