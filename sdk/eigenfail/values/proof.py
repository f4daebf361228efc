"""Proof by replay: the noise of an analysis, injected again in the same and other scenarios."""

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
        campaign: campaign of the replay; with `index`, its episode.
        outcome: outcome of the replay; None until it has ended.
        steps: number of steps of the replay.
        log_probability: log-probability of the noise injected, summed over these steps.
        log_probability_per_step: `log_probability` ÷ `steps`.
        expected_log_probability: average log-probability of noise of p(x) over the same steps, at
            the same sigma. The further `log_probability` lies below it, the less likely is the
            noise.
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
        """True if the replay failed again."""
        return self.outcome is not None and self.outcome.is_failure


class Reproduction(msgspec.Struct, frozen=True):
    """Share of replays that failed again.

    Attributes:
        rate: replays that failed again ÷ replays tried. They are not a random sample, so that only
            the counts are meaningful, not the interval. None before the first result. An errored
            replay does not count as tried.
        smallest_robustness_m: smallest robustness of the replays tried; 0 once a replay has failed
            again. [m]
    """

    rate: Rate | None = None
    smallest_robustness_m: float | None = None


class ProvenScenario(msgspec.Struct, frozen=True, kw_only=True):
    """The replays in one scenario.

    Attributes:
        scenario_parameters: parameters that differ from the scenario of the failures; none: the
            same scenario. If the analysed campaign's parameters vary, a mode and its eigenfailure
            have the scenario that the medoid drew. There is then a `ProvenScenario` for each
            scenario that medoids drew.
        drawn: values that the medoids of its modes drew, for the parameters that vary and are in
            effect.
        campaign: campaign of the replays; `state` is the state of this campaign.
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
        """Differences from the analysed scenario, and the values drawn, in words."""
        differs = ", ".join(f"{name} = {value}" for name, value in self.scenario_parameters.items())
        drawn = ", ".join(f"{name} = {_short(value)}" for name, value in self.drawn.items())
        text = differs or "the same"
        return f"{text} (drawn: {drawn})" if drawn else text

    @property
    def is_same(self) -> bool:
        """True if this is the scenario of the failures or medoids."""
        return not self.scenario_parameters


def _short(value: object) -> str:
    """Return a drawn value in words, with six digits, which are enough to distinguish draws."""
    return f"{value:.6g}" if isinstance(value, float) else str(value)


class NearestFailure(msgspec.Struct, frozen=True):
    """The failing noise nearest to a mode's centre, on the straight line to its medoid.

    Attributes:
        t: position on the line. 0: the centre itself fails. 1: no tried point before the medoid
            fails.
        campaign: with `index`, the episode that failed.
    """

    t: float
    campaign: int
    index: int

    @property
    def words(self) -> str:
        """The position on the line, in words."""
        if self.t == 0.0:
            return "t = 0: the centre itself fails"
        where = f"episode {self.campaign}/{self.index}"
        if self.t == 1.0:
            return f"t = 1: nothing before the medoid fails, {where}"
        return f"t = {self.t:.3g} of the way from the centre to the medoid, {where}"


class ProvenMode(msgspec.Struct, frozen=True):
    """Replays of the two trajectories of a mode, over all scenarios; `mode` counts from 0.

    Attributes:
        nearest: the failing noise nearest to the mode's centre, in the scenario of its failures:
            quote this noise as the eigenfailure. None until it is known.
    """

    mode: int
    eigenfailure: Reproduction
    medoid: Reproduction
    nearest: NearestFailure | None = None

    @property
    def number(self) -> int:
        """Number of the mode from 1, as on pages, in tables and in data frames."""
        return self.mode + 1


class Proof(Brief, Shown, msgspec.Struct, frozen=True, kw_only=True):
    """Proof of an analysis by replay, with the results so far.

    Attributes:
        done: whether there are replays, and all have ended.
        reproduced: replays of eigenfailures in the same scenario.
        eigenfailures: replays of eigenfailures in all scenarios together; `medoids` likewise.
        searches: campaigns of the method `nearest`, for modes whose centre does not fail.
        unplaced: modes, from 0, whose centre did not fail in the same scenario, and whose nearest
            failing point is unknown. Once the replays have ended, request them again to search for
            this point.
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
"""Planned positions of a vehicle's centre (x, y), in order of time [m]."""


class ExplainedStep(msgspec.Struct, frozen=True):
    """One step: the planner's account, and the true state.

    Attributes:
        acceleration_mps2: acceleration that the planner requested; steering_rad likewise.
        account: the planner's account; empty for a planner without explanations.
        disturbance: a_t / sigma_t of this step, for each channel [sigma].
        gap_m: true gap along the road from the truck's front to the rear bumper of `vehicle`; None
            if the account's vehicle is unknown or absent.
        closing_mps: true speed at which this gap closes.
        path: path that the planner intends from here, the present position first; empty for a
            planner that does not report one.
        vehicle: number of the vehicle that the account is about; None if unknown.
        ahead: number of the true next vehicle in the truck's path, or entering it.
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
    """An episode that was run to be explained.

    Attributes:
        result: result of the episode.
        steps: steps with a decision of the planner; without the true state if the episode errored.
        struck: number of the vehicle that the ego struck; None without a collision.
        undisturbed: the same failure run without noise, which shows whether noise is its cause;
            None if the episode does not fail, or could not be run without noise.
    """

    result: EpisodeResult
    steps: tuple[ExplainedStep, ...]
    struck: int | None = None
    undisturbed: "ExplainedEpisode | None" = None

    @property
    def fails_alike(self) -> bool:
        """True if the episode fails in the same way without noise, which is then not the cause."""
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
        differing: versions that have changed since the stored run, if the replay is not the same;
            null if they are unknown.
        unsteady: how a second replay differs from the first one, if the stack is not deterministic;
            null if both are the same, or there was only one.
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
    """A stored episode, run again and explained.

    Attributes:
        episode: address of the episode, as campaign/index.
        planner: name of the planner.
        verdict: whether the replay is the same as the stored episode, in words.
        note: remark on the planner's account; may be empty.
        steps: the requested steps; the story covers all steps.
        story: the course of the episode, a sentence for each notable event, in order of time.
        scene: scene of the replay, if the stored episode kept none and the replay is the same.
        undisturbed: outcome of the same failure without noise; None if the episode does not fail,
            or could not be run without noise.
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
