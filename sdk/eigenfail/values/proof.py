"""A proof by replay: what an analysis found, injected again in the same and in other scenarios."""

from enum import StrEnum

import msgspec

from eigenfail.values.campaign import CampaignState
from eigenfail.values.campaign_spec import Settings
from eigenfail.values.episode import EpisodeResult, Outcome
from eigenfail.values.estimates import Rate
from eigenfail.values.scene import Scene
from eigenfail.values.showing import Brief, Shown


class ReplayKind(StrEnum):
    """The kind of noise that is replayed for each mode of an analysis."""

    EIGENFAILURE = "eigenfailure"
    MEDOID = "medoid"


class ReplayedNoise(msgspec.Struct, frozen=True, kw_only=True):
    """One noise trajectory, injected again.

    Attributes:
        what: kind of noise: eigenfailure or medoid.
        mode: position in `AnalysisResult.modes`, from 0.
        campaign: the replay's; with `index` its episode.
        outcome: None while it is not in.
        steps: number of steps that it lasted.
        log_probability: log-probability of the noise injected, summed over these steps.
        log_probability_per_step: the same ÷ steps.
        expected_log_probability: average log-probability of noise of p(x) over the same steps, at
            the same sigma: how far below it `log_probability` lies is how unlikely the noise is.
    """

    what: ReplayKind
    mode: int
    campaign: int
    index: int
    outcome: Outcome | None = None
    steps: int | None = None
    robustness_m: float | None = None
    log_probability: float | None = None
    log_probability_per_step: float | None = None
    expected_log_probability: float | None = None

    @property
    def reproduced(self) -> bool:
        """Whether it failed again."""
        return self.outcome is not None and self.outcome.is_failure


class Reproduction(msgspec.Struct, frozen=True):
    """Share of replays that failed again.

    Attributes:
        rate: failed again ÷ tried, not a random sample: the count says how many, and the interval
            means nothing. None before the first result. A replay that errored was not tried.
        smallest_robustness_m: smallest robustness of those tried; 0 once one has failed again.
    """

    rate: Rate | None = None
    smallest_robustness_m: float | None = None


class ProvenScenario(msgspec.Struct, frozen=True, kw_only=True):
    """The replays in one scenario.

    Attributes:
        scenario_parameters: parameters that differ from those of the scenario in which the failures
            happened; none: the same scenario. If the analysed campaign's parameters vary, the
            scenario of a mode, and of its eigenfailure, is the one that its medoid drew, and there
            is an entry for each scenario that medoids drew.
        drawn: values that the medoids of its modes drew, for the parameters that vary and are in
            effect.
        campaign: campaign that replays; `state` is its own.
    """

    scenario_parameters: Settings
    campaign: int
    state: CampaignState
    eigenfailures: Reproduction
    medoids: Reproduction
    replays: tuple[ReplayedNoise, ...]
    drawn: Settings = {}

    @property
    def words(self) -> str:
        """In what it differs from the one that was analysed, and which draw it is."""
        differs = ", ".join(f"{name} = {value}" for name, value in self.scenario_parameters.items())
        drawn = ", ".join(f"{name} = {_short(value)}" for name, value in self.drawn.items())
        text = differs or "the same"
        return f"{text} (drawn: {drawn})" if drawn else text

    @property
    def is_same(self) -> bool:
        """Whether it is the scenario in which the failures, or the medoids, were found."""
        return not self.scenario_parameters


def _short(value: object) -> str:
    """A value that was drawn, with six digits, which are enough to distinguish draws."""
    return f"{value:.6g}" if isinstance(value, float) else str(value)


class NearestFailure(msgspec.Struct, frozen=True):
    """The failing noise nearest to a mode's centre, on the straight way to its medoid.

    Attributes:
        t: where it is on the way: 0, the centre itself fails; 1, nothing before the medoid does, as
            far as it was tried.
        campaign: with `index` the episode that failed.
    """

    t: float
    campaign: int
    index: int

    @property
    def words(self) -> str:
        """Where it is, in words."""
        if self.t == 0.0:
            return "t = 0: the centre itself fails"
        where = f"episode {self.campaign}/{self.index}"
        if self.t == 1.0:
            return f"t = 1: nothing before the medoid fails, {where}"
        return f"t = {self.t:.3g} of the way from the centre to the medoid, {where}"


class ProvenMode(msgspec.Struct, frozen=True):
    """What one mode's two trajectories did, over all scenarios; `mode` counts from 0.

    Attributes:
        nearest: the failing noise nearest to its centre, in the scenario of its failures: what to
            quote as its eigenfailure. None while that is not known.
    """

    mode: int
    eigenfailure: Reproduction
    medoid: Reproduction
    nearest: NearestFailure | None = None

    @property
    def number(self) -> int:
        """Number of the mode on pages, in tables and in data frames, which count from 1."""
        return self.mode + 1


class Proof(Brief, Shown, msgspec.Struct, frozen=True, kw_only=True):
    """Proof of an analysis by replay, with the results so far.

    Attributes:
        done: whether there are replays, and all have ended.
        reproduced: the eigenfailures in the same scenario.
        eigenfailures: replays of eigenfailures in all scenarios together; `medoids` likewise.
        searches: campaigns of the method `nearest`, for modes whose centre does not fail.
        unplaced: modes, from 0, whose centre did not fail in the same scenario, and whose nearest
            failing point is not known. Once the replays have ended, asking for them again searches
            it.
    """

    analysis: int
    done: bool
    reproduced: Reproduction
    eigenfailures: Reproduction
    medoids: Reproduction
    modes: tuple[ProvenMode, ...]
    scenarios: tuple[ProvenScenario, ...]
    searches: tuple[int, ...] = ()
    unplaced: tuple[int, ...] = ()


Account = dict[str, str | float]


Path = tuple[tuple[float, float], ...]
"""Positions of a vehicle's centre (x, y), in the order in which it means to pass them [m]."""


class ExplainedStep(msgspec.Struct, frozen=True):
    """One step: the planner's account, and the true state.

    Attributes:
        acceleration_mps2: what the planner asked for; steering_rad likewise.
        account: what it says; empty for a planner that explains nothing.
        disturbance: a_t / sigma_t of this step, of each channel [sigma].
        gap_m: gap from the truck's front to the rear bumper of `vehicle` along the road, in truth;
            None if nobody can say which vehicle the account is about, or it is not there.
        closing_mps: speed at which this gap closes, in truth.
        path: where the planner means to drive from here, the present position first; empty for a
            planner that reports none.
        vehicle: number of the vehicle that the account is about; None if that is not known.
        ahead: number of the next vehicle ahead in the truck's path, or entering it, in truth.
    """

    time_s: float
    acceleration_mps2: float
    steering_rad: float
    account: Account
    disturbance: tuple[float, ...]
    gap_m: float | None = None
    closing_mps: float | None = None
    path: Path = ()
    vehicle: int | None = None
    ahead: int | None = None


class ExplainedEpisode(msgspec.Struct, frozen=True, eq=False):
    """An episode that was run for the sake of its explanation.

    Attributes:
        result: what came of it, as of any episode.
        steps: steps in which the planner decided; without the true state if the episode errored.
        struck: number of the vehicle that the ego struck; None without a collision.
        undisturbed: a failure run again without noise, which tells whether noise is its cause;
            None for an episode that does not fail, and if it could not be run.
    """

    result: EpisodeResult
    steps: tuple[ExplainedStep, ...]
    struck: int | None = None
    undisturbed: "ExplainedEpisode | None" = None

    @property
    def fails_alike(self) -> bool:
        """Whether it fails in the same way without noise: noise is then not the cause."""
        calm = self.undisturbed
        return self.result.is_failure and calm is not None and calm.way_to_fail == self.way_to_fail

    @property
    def way_to_fail(self) -> tuple[Outcome, int | None, int | None]:
        """Outcome, number of the violated requirement, and the vehicle that was struck."""
        measures = self.result.measures
        return self.result.outcome, measures.violated if measures else None, self.struck


class Replayed(msgspec.Struct, frozen=True):
    """A stored result and the result of its replay.

    Attributes:
        differing: the versions under which it was run that are not those of now, where it is not
            the same; null if they are not known.
        unsteady: how a second replay differs from the first one, where the stack does not repeat
            itself; null if they are the same, or there was no second one.
    """

    index: int
    stored_outcome: Outcome
    stored_digest: str
    outcome: Outcome
    digest: str
    same: bool
    differing: tuple[str, ...] | None = None
    unsteady: str | None = None


class Explanation(Brief, msgspec.Struct, frozen=True, eq=False):
    """A stored episode, run again and accounted for.

    Attributes:
        episode: as campaign/index.
        planner: its name.
        verdict: whether the replay is the stored episode.
        note: what must be known about the planner's account; may be empty.
        steps: steps that were requested; the story covers all steps.
        story: what happened, a sentence for each thing of note, in the order of time.
        scene: scene of the replay, where the stored episode kept none and the replay is the same.
        undisturbed: outcome of a failure that was run again without noise; None for an episode that
            does not fail, and if it could not be run.
    """

    episode: str
    planner: str
    replayed: Replayed
    verdict: str
    note: str
    steps: tuple[ExplainedStep, ...]
    story: tuple[str, ...]
    scene: Scene | None = None
    undisturbed: Outcome | None = None
