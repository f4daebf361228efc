"""Samplers of Optuna over noise that is held: the black-box optimisers that users compare with.

Optuna (Akiba et al. 2019, KDD, 2623) has a CMA-ES, too, which is left out: its state is a pickled
object, and `cma` is the same strategy.
"""

from collections.abc import Callable, Sequence
from math import ceil, isfinite, nan
from typing import TYPE_CHECKING, Annotated, Literal

import msgspec
import numpy as np
from numpy.typing import NDArray

from eigenfail.contracts import MethodTraits
from eigenfail.errors import InvalidValue
from eigenfail.values.arrays import Floats
from eigenfail.values.episode import EpisodeResult, TrajectorySource
from eigenfail.values.learning import LearnerContext, Proposal, RoundSizes
from eigenfail_services.methods import Hold, archive, robustness_m

if TYPE_CHECKING:
    from optuna.samplers import BaseSampler

Array = NDArray[np.float64]

Sampler = Literal["tpe", "gp", "nsga2"]

MAX_EPISODES: dict[Sampler, int] = {"tpe": 5_000, "gp": 500, "nsga2": 20_000}
"""Most episodes, as the time for a proposal grows with their number (of `gp` with its square)."""

GENERATION, PARENTS = "NSGAIISampler:generation", "NSGAIISampler:parent:"
"""Names under which Optuna keeps the generation of a trial, and the parents of a generation."""


class OptunaSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Settings of `optuna`.

    `tpe` (tree-structured Parzen estimator) and `gp` (Gaussian process) minimise the robustness,
    and among failures the mean of z². `nsga2` looks for the Pareto front of both; where a campaign
    has several requirements, of the robustness of each and of the mean of z².
    """

    sampler: Annotated[
        Sampler,
        msgspec.Meta(description="`tpe` (at most 5,000 episodes), `gp` (500) or `nsga2` (20,000)"),
    ] = "tpe"
    hold: Hold = 10
    amplitude: Annotated[
        float, msgspec.Meta(gt=0.0, le=10.0, description="bound of the values [sigma]")
    ] = 2.0
    round_size: Annotated[
        int,
        msgspec.Meta(ge=2, le=10_000, description="episodes in a round; of `nsga2` a generation"),
    ] = 10

    def check_budget(self, episodes: int) -> None:
        """Raise InvalidValue for more episodes than the sampler can serve."""
        most = MAX_EPISODES[self.sampler]
        if episodes > most:
            raise InvalidValue(
                "episodes",
                f"{episodes:,} episodes are too many for `{self.sampler}`; the limit is {most:,}.",
                "Take another sampler, or run several seeds with fewer episodes each.",
            )

    def reach(self) -> str:
        """Return the largest disturbance that the method can choose, and how to go beyond it."""
        return (
            f"`optuna` chooses noise within ±{self.amplitude:g} sigma; a larger "
            "`settings.amplitude` reaches further."
        )


def score_single(result: EpisodeResult) -> tuple[float, ...]:
    """Return the robustness [m]; of a failure a number below 0, smaller for likelier noise."""
    robustness = robustness_m(result)
    return (robustness if robustness > 0.0 else -1.0 / (1.0 + find_mean_square(result)),)


def score_several(result: EpisodeResult) -> tuple[float, ...]:
    """Return the robustness of each requirement, in its unit, and the mean of z²."""
    found = result.requirements or (robustness_m(result),)
    whole = robustness_m(result)
    judged = (max(whole if each is None else each, 0.0) for each in found)
    return (*judged, find_mean_square(result))


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
    """Takes the noise of each episode from a sampler of Optuna, and reports the robustness to it.

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
        self._study: Study | None = None
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

    def _ask(self, study: "Study", count: int, seeds: np.random.SeedSequence) -> list[Array]:
        return study.ask(make_sampler(self._settings, int(seeds.generate_state(1)[0])), count)

    def _hold(self, candidate: Array) -> Floats:
        knots = candidate.reshape(-1, self._channels).astype(np.float32)
        return np.repeat(knots, self._settings.hold, axis=0)[: self._horizon]

    def observe(self, results: Sequence[EpisodeResult]) -> None:
        """Tell the sampler the scores of a round; episodes that could not be run have failed."""
        scores = [find_scores(self._settings.sampler, result) for result in results]
        if self._study is None:
            self._begin_study(scores)
            return
        self._study.tell(scores)

    def _begin_study(self, scores: Sequence[tuple[float, ...] | None]) -> None:
        found = [(x, each) for x, each in zip(self._first, scores, strict=True) if each]
        self._first = []
        if found:
            trials = TrialTable(
                points=np.stack([x for x, _ in found]),
                values=np.array([each for _, each in found]),
                generations=np.zeros(len(found), np.int64),
                states=np.ones(len(found), np.int64),
                parents=np.zeros(0, np.int64),
            )
            self._study = Study(trials, self._settings.amplitude)

    def state(self) -> bytes:
        """Return a state with all trials of the study, or the first round before there is one."""
        facts = self._Facts(self._rounds)
        if self._study is None:
            first = np.reshape(self._first, (-1, self._dimension)).astype(np.float64)
            return archive.write("optuna", facts, {"first": first})
        return archive.write("optuna", facts, msgspec.structs.asdict(self._study.list_trials()))

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
                    parents=archive.take(arrays, "parents", (len(arrays["parents"]),)),
                )
                study = Study(trials, self._settings.amplitude)
        self._rounds, self._first, self._study = facts.rounds, first, study


class TrialTable(msgspec.Struct, frozen=True, eq=False):
    """The trials of a study, in their order.

    Attributes:
        points: noise that was asked for, shape (n, dimension). [sigma]
        values: objectives, shape (n, objectives); NaN if none was told.
        generations: generation of each trial under `nsga2`, shape (n,); -1 of other samplers.
        states: number of the state that Optuna gives each trial, shape (n,).
        parents: numbers of the trials that the newest generation descends from.
    """

    points: Array
    values: Array
    generations: NDArray[np.int64]
    states: NDArray[np.int64]
    parents: NDArray[np.int64]


class Study:
    """A study of Optuna in memory, which can be written down as arrays.

    Args:
        trials: trials that it begins with.
        amplitude: bound of the values. [sigma]
    """

    def __init__(self, trials: TrialTable, amplitude: float) -> None:
        import optuna

        # Optuna tells of each study and of each trial on standard error.
        optuna.logging.set_verbosity(optuna.logging.ERROR)
        dimension, objectives = trials.points.shape[1], trials.values.shape[1]
        between = optuna.distributions.FloatDistribution(-amplitude, amplitude)
        self._distributions: dict[str, optuna.distributions.BaseDistribution] = {
            f"z{i}": between for i in range(dimension)
        }
        self._storage = optuna.storages.InMemoryStorage()
        self._study = optuna.create_study(
            storage=self._storage, directions=["minimize"] * objectives
        )
        self._id = self._storage.get_study_id_from_name(self._study.study_name)
        rows = zip(trials.points, trials.values, trials.generations, trials.states, strict=True)
        for point, values, generation, state in rows:
            self._study.add_trial(
                optuna.trial.create_trial(
                    state=optuna.trial.TrialState(int(state)),
                    values=None if np.isnan(values).any() else values.tolist(),
                    params=dict(zip(self._distributions, point.tolist(), strict=True)),
                    distributions=self._distributions,
                    system_attrs={} if generation < 0 else {GENERATION: int(generation)},
                )
            )
        # Without them NSGA-II would choose the parents anew, through all generations and, where
        # trials are equally good, others.
        if len(trials.parents):
            name = f"{PARENTS}{trials.generations.max()}"
            self._storage.set_study_system_attr(self._id, name, trials.parents.tolist())

    def ask(self, sampler: "BaseSampler", count: int) -> list[Array]:
        """Return points that the sampler wants to be tried."""
        self._study.sampler = sampler
        trials = [self._study.ask(self._distributions) for _ in range(count)]
        return [np.array(list(trial.params.values())) for trial in trials]

    def tell(self, scores: Sequence[tuple[float, ...] | None]) -> None:
        """Tell the scores of the last points; None of those that could not be tried."""
        trials = self._study.get_trials(deepcopy=False)[-len(scores) :]
        for trial, score in zip(trials, scores, strict=True):
            if score is None:
                self._study.tell(trial.number, state=trial.state.FAIL)
            else:
                self._study.tell(trial.number, score)

    def list_trials(self) -> TrialTable:
        """Return the trials, and the parents of the newest generation."""
        trials = self._study.get_trials(deepcopy=False)
        nothing = [nan] * len(self._study.directions)
        generations = np.array([each.system_attrs.get(GENERATION, -1) for each in trials])
        kept = self._storage.get_study_system_attrs(self._id)
        return TrialTable(
            points=np.array([list(each.params.values()) for each in trials]),
            values=np.array([each.values or nothing for each in trials]),
            generations=generations,
            states=np.array([int(each.state) for each in trials]),
            # In a study of its own in memory the identifier of a trial is its number.
            parents=np.array(kept.get(f"{PARENTS}{generations.max()}", ()), np.int64),
        )


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
