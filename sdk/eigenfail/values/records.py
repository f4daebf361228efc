"""What the store keeps beside campaigns, results and analyses."""

from enum import StrEnum

import msgspec

from eigenfail.values.arrays import Floats
from eigenfail.values.episode import EpisodeResult, Outcome


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


class EpisodeRow(msgspec.Struct, frozen=True, kw_only=True):
    """An episode in a list: what happened, without its trajectories.

    Attributes:
        log_probability: sum of log p(a_t) until the episode ended.
        problem: why it failed, as "kind: message"; empty unless the outcome is `failed`.
    """

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
    wall_s: float
    finished_ms: int
    digest: str
    has_scene: bool
    problem: str = ""


class Totals(msgspec.Struct, frozen=True):
    """Sums over the failures of a campaign, from which its summary is made."""

    failures: int
    log_probability: float
    steps: int
    severity: float


class Failures(msgspec.Struct, frozen=True, eq=False):
    """The noise of all failures of a campaign.

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
