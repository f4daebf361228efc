"""A proof by replay: what an analysis found, injected again in the same and in other scenarios."""

from enum import StrEnum

import msgspec

from eigenfail.values.campaign import CampaignState, Rate, Settings
from eigenfail.values.episode import Outcome
from eigenfail.values.showing import Brief, Shown


class ReplayKind(StrEnum):
    """What is replayed of an analysis: one noise trajectory for each of its modes."""

    EIGENFAILURE = "eigenfailure"
    MEDOID = "medoid"


class ReplayedNoise(msgspec.Struct, frozen=True, kw_only=True):
    """One noise trajectory, injected again.

    Attributes:
        what: which of its mode's two it is.
        mode: position in `AnalysisResult.modes`, from 0.
        campaign: the replay's; with `index` its episode.
        outcome: None while it is not in.
        steps: that it lasted.
        log_probability: of the noise injected, summed over these steps.
        log_probability_per_step: the same ÷ steps.
        expected_log_probability: that noise of p(x) has on average over the same steps, at the same
            sigma: how far below it `log_probability` lies is how unlikely the noise is.
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
        """Whether it ended in a collision again."""
        return self.outcome is Outcome.COLLISION


class Reproduction(msgspec.Struct, frozen=True):
    """How many of some replays failed again.

    Attributes:
        rate: failed again ÷ tried, with Wilson's interval; None before the first result. A replay
            that errored was not tried.
        smallest_robustness_m: of those tried; 0 once one has failed again.
    """

    rate: Rate | None = None
    smallest_robustness_m: float | None = None


class ProvenScenario(msgspec.Struct, frozen=True, kw_only=True):
    """The replays in one scenario.

    Attributes:
        scenario_parameters: those that differ from the scenario in which the failures happened;
            none: the same scenario. Where the analysed campaign's parameters vary, the scenario of
            a mode, and of its eigenfailure, is the one that its medoid drew, and there is an entry
            for each scenario that medoids drew.
        drawn: of those that vary, what the medoids of its modes drew, as far as it is in effect.
        campaign: that replays; `state` is its own.
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
        told = differs or "the same"
        return f"{told} (drawn: {drawn})" if drawn else told

    @property
    def is_same(self) -> bool:
        """Whether it is the scenario in which the failures, or the medoids, were found."""
        return not self.scenario_parameters


def _short(value: object) -> str:
    """A value that was drawn: six digits tell it apart."""
    return f"{value:.6g}" if isinstance(value, float) else str(value)


class ProvenMode(msgspec.Struct, frozen=True):
    """What one mode's two trajectories did, over all scenarios; `mode` counts from 0."""

    mode: int
    eigenfailure: Reproduction
    medoid: Reproduction

    @property
    def number(self) -> int:
        """Number of the mode on pages, in tables and in data frames, which count from 1."""
        return self.mode + 1


class Proof(Brief, Shown, msgspec.Struct, frozen=True, kw_only=True):
    """How far replays bear an analysis out, with the results that are in.

    Attributes:
        done: whether there are replays, and all have ended.
        reproduced: the eigenfailures in the same scenario.
        eigenfailures: in all scenarios together; `medoids` likewise.
    """

    analysis: int
    done: bool
    reproduced: Reproduction
    eigenfailures: Reproduction
    medoids: Reproduction
    modes: tuple[ProvenMode, ...]
    scenarios: tuple[ProvenScenario, ...]
