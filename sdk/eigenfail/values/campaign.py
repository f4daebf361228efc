"""A campaign: a budgeted search for failures of one planner, with one method, from one seed."""

from enum import StrEnum
from typing import Annotated, Any

import msgspec

from eigenfail.values.disturbance import DisturbanceModel
from eigenfail.values.episode import EpisodeSetup
from eigenfail.values.priority import Priority
from eigenfail.values.randomness import MAX_SEED
from eigenfail.values.showing import Shown
from eigenfail.values.stopping import StopRules

MAX_EPISODES = 10_000_000
LONGEST_NAME = 200

Name = Annotated[str, msgspec.Meta(min_length=1, max_length=LONGEST_NAME)]
Settings = dict[str, Any]


class CampaignSpec(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """What a user asks for.

    Attributes:
        episodes: the budget; every simulated episode counts.
        stop: what ends it before that.
        price_usd_per_hour: of one instance.
        instances: how many instances the campaign occupies while it runs.
        scene_every: besides all collisions, keep the scene of every n-th episode.
        priority: how large its share of the workers is beside other campaigns, and how soon it has
            its turn; it may be changed later, and changes no episode.
    """

    name: Name
    method: Name
    episodes: Annotated[int, msgspec.Meta(ge=1, le=MAX_EPISODES)]
    seed: Annotated[int, msgspec.Meta(ge=0, le=MAX_SEED)] = 0
    settings: Settings = {}
    scenario: Name = "cut_in"
    scenario_parameters: Settings = {}
    planner: Name = "rulebook"
    planner_settings: Settings = {}
    simulator: Name = "highway"
    disturbance: DisturbanceModel = DisturbanceModel()
    stop: StopRules = StopRules()
    price_usd_per_hour: Annotated[float, msgspec.Meta(ge=0.0, le=100_000.0)] = 1.20
    instances: Annotated[int, msgspec.Meta(ge=1, le=100_000)] = 1
    scene_every: Annotated[int, msgspec.Meta(ge=1, le=MAX_EPISODES)] = 50
    priority: Priority = Priority.NORMAL

    def is_like(self, other: "CampaignSpec") -> bool:
        """Whether both ask for the same, at whatever priority."""
        return msgspec.structs.replace(self, priority=other.priority) == other

    def setup(self) -> EpisodeSetup:
        """What all of its episodes share."""
        return EpisodeSetup(
            simulator=self.simulator,
            scenario=self.scenario,
            scenario_parameters=self.scenario_parameters,
            planner=self.planner,
            planner_settings=self.planner_settings,
            disturbance=self.disturbance,
            scene_every=self.scene_every,
        )


class CampaignState(StrEnum):
    """Where a campaign is in its life; the transitions are in `campaigns.lifecycle`."""

    QUEUED = "queued"
    RUNNING = "running"
    PAUSING = "pausing"
    PAUSED = "paused"
    CANCELLING = "cancelling"
    CANCELLED = "cancelled"
    DONE = "done"
    DEAD = "dead"


FINAL_STATES = frozenset({CampaignState.CANCELLED, CampaignState.DONE, CampaignState.DEAD})


class Counts(msgspec.Struct, frozen=True):
    """planned = completed + failed + cancelled + open, at every commit.

    `failures` counts the collisions among the completed episodes; `failed` counts the episodes
    that could not be run; `cancelled` counts those that were left unrun when the campaign ended,
    whoever ended it: a user, a stop rule, or a method with no more to propose; `duplicates` counts
    results that came a second time.
    """

    planned: int
    completed: int = 0
    failures: int = 0
    failed: int = 0
    cancelled: int = 0
    duplicates: int = 0

    @property
    def open(self) -> int:
        """Episodes still to come."""
        return self.planned - self.completed - self.failed - self.cancelled


class Interval(msgspec.Struct, frozen=True):
    """A 95 % confidence interval."""

    low: float
    high: float


class Estimate(msgspec.Struct, frozen=True, kw_only=True):
    """The failure probability under p(x), as a learner knows it after its last whole round.

    Attributes:
        by: how it was found: "subset simulation" or "importance sampling".
        episodes: how many it rests on.
        probability: None where it cannot be told honestly; `problem` then says why.
        cv: coefficient of variation: standard error ÷ probability.
        interval: of 95 %.
        effective: effective sample size, of weighted samples.
        problem: why there is no number, and what to do; empty otherwise.
        note: what neither the number nor its interval can know.
    """

    by: str
    episodes: int
    probability: float | None = None
    cv: float | None = None
    interval: Interval | None = None
    effective: float | None = None
    problem: str = ""
    note: str = ""


class Overhead(msgspec.Struct, frozen=True):
    """What a campaign's active time went into beside simulation, as the hub measured it.

    Attributes:
        learning_s: no episode was with a worker, and the learner worked; its start included.
        waiting_s: neither: the campaign waited for workers or for the database.
        discarded_s: worker time in results that were thrown away: second ones of an episode, and
            those that the store did not want.
    """

    learning_s: float = 0.0
    waiting_s: float = 0.0
    discarded_s: float = 0.0


class Campaign(Shown, msgspec.Struct, frozen=True, kw_only=True):
    """A campaign as it stands.

    Attributes:
        stopped_because: why it is in its final state, in words; empty before.
        active_s: time during which it was running; pauses do not count.
        digest: over all results in index order, once the campaign is done.
        estimate: of the failure probability; None where the method tells none, or none yet.
        overhead: what of `active_s` was no simulation; None where nobody measured it.
        trained_episodes: how many its learner was trained with so far; None where the method does
            not say.
    """

    id: int
    spec: CampaignSpec
    state: CampaignState
    counts: Counts
    created_ms: int
    started_ms: int | None = None
    ended_ms: int | None = None
    active_s: float = 0.0
    stopped_because: str = ""
    digest: str | None = None
    estimate: Estimate | None = None
    overhead: Overhead | None = None
    trained_episodes: int | None = None


class Rate(msgspec.Struct, frozen=True):
    """k of n, with its interval."""

    value: float
    k: int
    n: int
    interval: Interval


class Cost(msgspec.Struct, frozen=True):
    """What a campaign cost.

    Attributes:
        total_usd: price per instance-hour × instance-hours.
        per_failure_usd: total ÷ failures; None while there is none.
        interval_usd: of the cost per failure, from the interval of the failure rate;
            None while there is no failure.
        at_least_usd: lower bound of the cost per failure (95 %), which holds without failures too.
    """

    total_usd: float
    instance_hours: float
    per_failure_usd: float | None
    interval_usd: Interval | None
    at_least_usd: float | None
