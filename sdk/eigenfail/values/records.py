"""What the store keeps beside campaigns, results and analyses."""

from enum import StrEnum

import msgspec

from eigenfail.values.arrays import Floats
from eigenfail.values.assessment import Assessment, assess
from eigenfail.values.episode import EpisodeResult, Outcome
from eigenfail.values.measures import LaterMeasures


class Delivery(msgspec.Struct, frozen=True, eq=False):
    """A result and the worker that brought it."""

    result: EpisodeResult
    worker: str


class Verdict(StrEnum):
    """What became of a delivered result.

    `kept`: it is the episode's one result. `duplicate`: the episode has the same result already.
    `alarm`: the episode has another result: something is not deterministic. `unwanted`: the
    campaign has ended.
    """

    KEPT = "kept"
    DUPLICATE = "duplicate"
    ALARM = "alarm"
    UNWANTED = "unwanted"


class _EpisodeIdentity(LaterMeasures, frozen=True):
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
        assessed: what outcome and measures say together.
        problem: why it errored, as "kind: message"; empty unless the outcome is `failed`.
        noise_pruned_ms: when its noise and scene were taken away; None if they are kept.
    """

    wall_s: float
    finished_ms: int
    digest: str
    has_scene: bool
    assessed: Assessment = Assessment()
    problem: str = ""
    noise_pruned_ms: int | None = None


class EpisodeDetail(EpisodeResult, frozen=True, eq=False, kw_only=True):
    """A result with what outcome and measures say together, as the service tells it."""

    assessed: Assessment = Assessment()


def add_assessment(result: EpisodeResult) -> EpisodeDetail:
    """The result with its assessment."""
    assessed = assess(result.outcome, result.measures)
    return EpisodeDetail(**msgspec.structs.asdict(result), assessed=assessed)


class ConflictTotals(msgspec.Struct, frozen=True):
    """Counts and sums over the episodes of a campaign by conflict class; see `assess`.

    Attributes:
        unclassified: collisions of which too little was measured to class them.
        ttc_lead_s: sum of the lead times of MinTTC, of which there are `ttc_leads`.
        drac_lead_s: sum of the lead times of DRAC, of which there are `drac_leads`.
        unresolved: episodes that ended while braking could not avoid a collision any more.
        perhaps_unresolved: of which too little was measured to say whether they did.
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
    perhaps_unresolved: int = 0


class FrequentFault(msgspec.Struct, frozen=True):
    """The most frequent reason for which episodes of a campaign errored.

    Attributes:
        kind: infrastructure, simulator, planner, solver or input.
        message: the reason itself; of equally frequent ones that of the earliest episode.
        episodes: number of episodes with this reason.
        first: index of the first of them.
    """

    kind: str
    message: str
    episodes: int
    first: int


class Totals(msgspec.Struct, frozen=True):
    """Sums over the failures of a campaign, from which its summary is made.

    Attributes:
        severity: None where no failure has one.
        conflicts: over all completed episodes.
        fault: of the errored episodes; None where none errored.
    """

    failures: int
    log_probability: float
    steps: int
    severity: float | None
    conflicts: ConflictTotals = ConflictTotals()
    fault: FrequentFault | None = None


PORTION = 2_000
"""How many failures are read at a time at most."""


class Failures(msgspec.Struct, frozen=True, eq=False):
    """The noise of failures of a campaign.

    Attributes:
        indices: the episodes, in index order.
        noise: z of each, shape (steps of the episode, 2). [sigma]
    """

    indices: tuple[int, ...]
    noise: tuple[Floats, ...]


class JobKind(StrEnum):
    """What a job works on; its subject is an id of that kind."""

    CAMPAIGN = "campaign"
    ANALYSIS = "analysis"


class Job(msgspec.Struct, frozen=True):
    """A claimed piece of work; the token proves the claim."""

    id: int
    kind: JobKind
    subject: int
    token: str
    attempts: int
