"""Stored records other than campaigns, results and analyses."""

from enum import StrEnum
from typing import Annotated, Generic, TypeVar

import msgspec

from eigenfail.values.arrays import Floats
from eigenfail.values.disturbance import AXES, ChannelLikelihood
from eigenfail.values.episode import EpisodeResult, Outcome
from eigenfail.values.measures import LaterMeasures, Measure, Measures, read_declarations
from eigenfail.values.scene import PEAK_BRAKING_MPS2
from eigenfail.values.showing import Shown

NEAR_MISS_TTC_S = 1.5
"""A time to collision below this is a violation."""


class ConflictClass(StrEnum):
    """Conflict class of an episode.

    `unavoidable`: a collision that peak braking could not avoid once MinTTC was violated, or
    without such a violation before the contact. `planner_failure`: any other collision, which was
    not shown to be unavoidable. `near_miss`: MinTTC < 1.5 s without a collision. `none`: neither
    a collision nor a near miss.
    """

    UNAVOIDABLE = "unavoidable"
    PLANNER_FAILURE = "planner_failure"
    NEAR_MISS = "near_miss"
    NONE = "none"


IN_WORDS = {
    ConflictClass.UNAVOIDABLE: "collision, unavoidable",
    ConflictClass.PLANNER_FAILURE: "collision, planner failure",
    ConflictClass.NEAR_MISS: "near miss",
    ConflictClass.NONE: "no conflict",
}


UNRESOLVED = "unresolved at the horizon"
"""Added to the class of an episode that ended too early to be called safe."""


class Assessment(msgspec.Struct, frozen=True):
    """Conflict class and lead times of an episode.

    Attributes:
        conflict: conflict class; None if the episode was not run, or ended in a collision that was
            stored before there were classes.
        ttc_lead_s: time from the first violation of MinTTC to the collision [s]; None if either is
            missing.
        drac_lead_s: time from the first violation of DRAC to the collision [s]; None if either is
            missing.
        unresolved: whether the episode ended at its horizon when braking could no longer avoid a
            collision.
    """

    conflict: ConflictClass | None = None
    ttc_lead_s: Annotated[
        float | None,
        Measure(
            label="lead time of TTC",
            unit="s",
            words="from ttc_violated_s to the collision",
            formula="`collided_s` − `ttc_violated_s`",
        ),
    ] = None
    drac_lead_s: Annotated[
        float | None,
        Measure(
            label="lead time of DRAC",
            unit="s",
            words="from drac_violated_s to the collision",
            formula="`collided_s` − `drac_violated_s`",
        ),
    ] = None
    unresolved: bool = False

    @property
    def words(self) -> str:
        """The class in words, with a remark if the episode is unresolved; empty without a class."""
        return self.beside(IN_WORDS[self.conflict] if self.conflict else "")

    def beside(self, words: str) -> str:
        """Return the words, with a remark if the episode was unresolved at the horizon."""
        return ", ".join(filter(None, (words, UNRESOLVED if self.unresolved else "")))


LEAD_TIMES = read_declarations(Assessment)
"""Declarations of the measures that follow from outcome and measures."""


def assess(outcome: Outcome, measures: Measures | None) -> Assessment:
    """Classify an episode.

    A collision is judged by DRAC at the first violation of MinTTC by the vehicle struck, not by the
    maximum of DRAC. DRAC = v² / (2 · gap) tends to infinity at contact, so that the maximum would
    make every collision unavoidable.
    """
    # An errored episode is counted as such, and not as unresolved besides.
    if measures is None or outcome is Outcome.ERRORED:
        return Assessment()
    if outcome is not Outcome.COLLISION and measures.collided_s is not None:
        return Assessment()  # no requirement forbids the collision
    if outcome is not Outcome.COLLISION:
        near = measures.min_ttc_s is not None and measures.min_ttc_s < NEAR_MISS_TTC_S
        conflict = ConflictClass.NEAR_MISS if near else ConflictClass.NONE
        return Assessment(conflict, unresolved=outcome is Outcome.SAFE and is_unresolved(measures))
    return Assessment(
        _of_collision(measures),
        _lead_s(measures, measures.ttc_violated_s),
        _lead_s(measures, measures.drac_violated_s),
    )


def is_unresolved(measures: Measures) -> bool:
    """Return whether a collision-free episode ended when braking could no longer avoid a collision.

    At a closing speed v and a gap g, constant braking avoids the crash if DRAC = v² / (2 · g)
    (FHWA-RD-03-050) is at most the ego's peak braking. Peak braking is 7.0 m/s² if the
    simulator does not state it. Other vehicles are assumed to keep their velocities.
    """
    return not _can_brake(measures, measures.final_drac_mps2 or 0.0)


def _can_brake(measures: Measures, need_mps2: float) -> bool:
    peak_mps2 = measures.peak_braking_mps2
    return need_mps2 <= (PEAK_BRAKING_MPS2 if peak_mps2 is None else peak_mps2)


def _of_collision(measures: Measures) -> ConflictClass | None:
    if measures.collided_s is None:
        return None
    need_mps2 = measures.drac_at_warning_mps2
    # Without a warning there was nothing to brake for before the contact.
    hopeless = need_mps2 is None or not _can_brake(measures, need_mps2)
    return ConflictClass.UNAVOIDABLE if hopeless else ConflictClass.PLANNER_FAILURE


def _lead_s(measures: Measures, violated_s: float | None) -> float | None:
    if measures.collided_s is None or violated_s is None:
        return None
    return measures.collided_s - violated_s


class Delivery(msgspec.Struct, frozen=True, eq=False):
    """A result and the worker that brought it."""

    result: EpisodeResult
    worker: str


class Verdict(StrEnum):
    """The fate of a delivered result.

    `kept`: it is the episode's only result. `duplicate`: the episode already has the same result.
    `alarm`: the episode already has a different result: something is not deterministic. `unwanted`:
    it was not stored. The campaign has ended, was removed or belongs to another service, or the
    result's seed, steps or shapes do not fit the campaign.
    """

    KEPT = "kept"
    DUPLICATE = "duplicate"
    ALARM = "alarm"
    UNWANTED = "unwanted"


class _EpisodeIdentity(Shown, LaterMeasures, frozen=True):
    # Positional fields stand before the inherited ones, which are keyword-only: this class exists
    # for the order of the fields in answers and files.
    campaign: int
    index: int
    seed: int
    outcome: Outcome
    steps: int
    source: str
    worker: str
    robustness_m: float | None
    log_probability: float
    severity: float | None
    min_ttc_s: float | None
    max_drac_mps2: float | None


class EpisodeRow(_EpisodeIdentity, frozen=True, kw_only=True):
    """An episode in a list: what happened, without its trajectories; measures as in `Measures`.

    Attributes:
        log_probability: sum of log p(a_t) until the episode ended.
        assessed: assessment of the episode from outcome and measures.
        problem: why it errored, as "kind: message"; empty unless the outcome is `failed`.
        noise_pruned_ms: when its noise and scene were removed; None if they are kept.
        requirements: robustness of each requirement that its campaign names, in their order.
        mode: number of its failure mode, from 1, in the newest finished analysis of its campaign;
            None if the episode was not analysed.
    """

    wall_s: float
    finished_ms: int
    digest: str
    has_scene: bool
    assessed: Assessment = Assessment()
    problem: str = ""
    noise_pruned_ms: int | None = None
    requirements: tuple[float | None, ...] = ()
    mode: int | None = None


class EpisodeDetail(Shown, EpisodeResult, frozen=True, eq=False, kw_only=True):
    """A result with its assessment from outcome and measures, as the service returns it.

    Attributes:
        channels: names of the channels of the noise, in the order of the columns of z.
        likelihoods: how likely the noise of each channel was; empty for an episode without a step.
        campaign: id of its campaign; None if an older service does not report it.
    """

    assessed: Assessment = Assessment()
    channels: tuple[str, ...] = AXES
    likelihoods: tuple[ChannelLikelihood, ...] = ()
    campaign: int | None = None


class ConflictTotals(msgspec.Struct, frozen=True):
    """Counts and sums over the episodes of a campaign by conflict class; see `assess`.

    Attributes:
        unclassified: collisions with too few measurements for a class.
        allowed: collisions that no requirement forbids; they are not failures, and not in a class.
        ttc_lead_s: sum of the `ttc_leads` lead times of MinTTC.
        drac_lead_s: sum of the `drac_leads` lead times of DRAC.
        unresolved: episodes that ended when braking could no longer avoid a collision.
    """

    unavoidable: int = 0
    planner_failures: int = 0
    unclassified: int = 0
    near_misses: int = 0
    ttc_lead_s: float = 0.0
    ttc_leads: int = 0
    drac_lead_s: float = 0.0
    drac_leads: int = 0
    unresolved: int = 0
    allowed: int = 0

    @property
    def collisions(self) -> int:
        """Number of failures by collision, of any class; all other failures are violations."""
        return self.unavoidable + self.planner_failures + self.unclassified


class FrequentFault(msgspec.Struct, frozen=True):
    """The most frequent reason for which episodes of a campaign errored.

    Attributes:
        kind: infrastructure, simulator, planner, solver or input.
        message: the reason; among equally frequent reasons, the reason of the earliest episode.
        episodes: number of episodes with this reason.
        first: index of the first episode with this reason.
    """

    kind: str
    message: str
    episodes: int
    first: int


class Totals(msgspec.Struct, frozen=True):
    """Sums over the failures of a campaign, for its summary.

    Attributes:
        severity: sum of severities; None if no failure has a severity.
        conflicts: totals by conflict class over all completed episodes.
        fault: most frequent fault of the errored episodes; None if none errored.
        first_failure: smallest index of a failure; None without one.
    """

    failures: int
    log_probability: float
    steps: int
    severity: float | None
    conflicts: ConflictTotals = ConflictTotals()
    fault: FrequentFault | None = None
    first_failure: int | None = None


PORTION = 2_000
"""Maximum number of failures that are read at a time."""


class Failures(msgspec.Struct, frozen=True, eq=False):
    """The noise of failures of a campaign.

    Attributes:
        indices: indices of the episodes, in order.
        noise: z of each episode, shape (steps of the episode, channels). [sigma]
        seeds: seed of each episode; empty if they do not matter.
    """

    indices: tuple[int, ...]
    noise: tuple[Floats, ...]
    seeds: tuple[int, ...] = ()


class FailureCourse(msgspec.Struct, frozen=True, eq=False):
    """The speed of the ego over a failure, and where all vehicles were at its end.

    Attributes:
        index: index of the episode.
        dt_s: duration of a step.
        speed_mps: speed of the ego at the start and after each step, shape (steps + 1,).
        end: x [m], y [m], heading [rad] and speed [m/s] of all vehicles before and after the last
            step, shape (2, vehicles, 4), or (1, vehicles, 4) without a step; vehicle 0 is the ego.
            NaN while a vehicle is absent. None if the states are unknown.
        sizes: length and width [m] of all vehicles, shape (vehicles, 2); None without `end`.
    """

    index: int
    dt_s: float
    speed_mps: Floats
    end: Floats | None = None
    sizes: Floats | None = None


def make_failure_course(index: int, dt_s: float, vehicles: Floats, sizes: Floats) -> FailureCourse:
    """Return the course of a failure from parts of its `Scene`, which can then be dropped."""
    return FailureCourse(index, dt_s, vehicles[:, 0, 3].copy(), vehicles[-2:].copy(), sizes)


class JobKind(StrEnum):
    """Kind of a job: its subject is the id of a campaign or of an analysis."""

    CAMPAIGN = "campaign"
    ANALYSIS = "analysis"


class Job(msgspec.Struct, frozen=True):
    """A claimed job; the token proves the claim."""

    id: int
    kind: JobKind
    subject: int
    token: str
    attempts: int


Item = TypeVar("Item")


class Page(msgspec.Struct, Generic[Item], frozen=True):
    """A page of items, and the cursor of the next page (None at the end).

    Attributes:
        total: number of items that match the request, on all pages together; absent if the
            request did not ask for it.
    """

    items: tuple[Item, ...]
    next: int | None = None
    total: int | msgspec.UnsetType = msgspec.UNSET
