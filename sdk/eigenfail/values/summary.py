"""The result of a campaign: the row of a result table."""

import msgspec

from eigenfail.values.campaign import Counts
from eigenfail.values.episode import Outcome
from eigenfail.values.estimates import Cost, Estimate, Rate
from eigenfail.values.showing import Brief, Shown


class MeanTime(msgspec.Struct, frozen=True):
    """A mean over n episodes [s]; None if n is 0."""

    mean_s: float | None = None
    n: int = 0


class Conflicts(msgspec.Struct, frozen=True):
    """The completed episodes of a campaign by conflict class, with lead times of collisions.

    Attributes:
        unavoidable: collisions that braking could not avoid once they showed.
        planner_failures: collisions that braking could have avoided.
        unclassified: collisions with too few measurements for a class.
        near_misses: MinTTC < 1.5 s without a collision.
        allowed: collisions that no requirement forbids; they are not failures, and not in a class.
        ttc_lead: mean time from the first violation of MinTTC to the collision.
        drac_lead: mean time from the first violation of DRAC to the collision.
    """

    unavoidable: int = 0
    planner_failures: int = 0
    unclassified: int = 0
    near_misses: int = 0
    ttc_lead: MeanTime = MeanTime()
    drac_lead: MeanTime = MeanTime()
    allowed: int = 0

    @property
    def collisions(self) -> int:
        """Number of failures by collision, of any class; all other failures are violations."""
        return self.unavoidable + self.planner_failures + self.unclassified


UPPER_BOUNDS = "Upper bounds count such episodes as failures."


class Unresolved(msgspec.Struct, frozen=True):
    """Episodes that ended safe when braking could no longer avoid a collision.

    Attributes:
        count: number of unresolved episodes; they are not failures.
        horizon_s: duration of an episode without a collision, the longest one if it varies [s];
            None if the duration of a step is undefined, or the scenario is unknown here.
    """

    count: int = 0
    horizon_s: float | None = None

    def words(self, completed: int) -> str:
        """Return sentences on the unresolved episodes; empty without any."""
        if not self.count:
            return ""
        within = "" if self.horizon_s is None else f" within {self.horizon_s:g} s"
        return (
            f"{self.count:,} of {completed:,} had no collision{within}, but ended while braking "
            f"could not avoid one any more. {UPPER_BOUNDS}"
        )


class Errored(msgspec.Struct, frozen=True):
    """Episodes of a campaign that could not be completed, and their most frequent reason.

    Attributes:
        count: number of errored episodes. Rates leave them out, and upper bounds count them as
            failures.
        kind: kind of the most frequent reason: infrastructure, simulator, planner, solver or input.
        reason: the most frequent reason, in words; among equally frequent ones, the earliest.
        times: number of episodes with that reason.
        first: index of the first episode with that reason.
    """

    count: int = 0
    kind: str = ""
    reason: str = ""
    times: int = 0
    first: int | None = None

    def words(self, counts: Counts) -> str:
        """Return a sentence on the errored episodes; empty if there are none.

        Args:
            counts: counts of the same campaign; its rate is over the completed episodes.
        """
        if not self.count:
            return ""
        if counts.completed:
            total = self.count + counts.completed
            text = (
                f"{self.count:,} of {total:,} episodes errored: the rate leaves them out, and an "
                "upper bound counts them as failures"
            )
        else:
            every = "The only episode" if self.count == 1 else f"All {self.count:,} episodes"
            text = f"{every}{' so far' if counts.open else ''} errored, so there is no result"
        return f"{text}. {self.most_frequent}".strip()

    @property
    def most_frequent(self) -> str:
        """The most frequent reason in a sentence, with its kind; empty if unknown."""
        if not self.times:
            return ""
        times = "" if self.times == self.count else f", {self.times:,} times"
        return f"Most frequent reason ({self.kind}{times}): {self.reason}"


class Summary(Shown, msgspec.Struct, frozen=True):
    """The row of a campaign in a result table.

    Attributes:
        failure_rate: failure rate over the completed episodes, within the horizon; None before the
            first one.
        mean_log_probability: mean log-probability of the failures, summed over their steps.
        log_probability_per_step: log-probability per step of the failures: sum of log p over all
            their steps ÷ steps.
        mean_severity: mean severity of the collisions [m²/s²].
        estimate: estimate of the failure probability under p(x); None if the method does not give
            one, or has not yet.
        unresolved: episodes that are safe only because they ended.
        errored: episodes that could not be completed, with their most frequent reason.
        reach: for a campaign that ended without a failure: disturbances that its method cannot
            choose, and what to do; empty if the method can choose any.
        rate_note: how the failure rate under p(x) is estimated if a stop rule judged failures;
            empty for other campaigns.
        first_failure: index of the first episode that failed; None without one.
    """

    campaign: int
    name: str
    method: str
    counts: Counts
    failure_rate: Rate | None
    mean_log_probability: float | None
    log_probability_per_step: float | None
    mean_severity: float | None
    episodes_per_s: float | None
    cost: Cost
    conflicts: Conflicts = Conflicts()
    estimate: Estimate | None = None
    unresolved: Unresolved = Unresolved()
    errored: Errored = Errored()
    reach: str = ""
    rate_note: str = ""
    first_failure: int | None = None

    @property
    def remark(self) -> str:
        """The remarks on the rate, and why the failure probability is missing; empty if none."""
        problem = self.estimate.problem if self.estimate else ""
        no_probability = f"No failure probability: {problem}" if problem else ""
        return " ".join(filter(None, (self.rate_remark, no_probability)))

    @property
    def rate_remark(self) -> str:
        """The remarks on the failure rate, as sentences; empty if there are none."""
        missed = f"No failure was found. {self.reach}" if self.reach else ""
        unresolved = self.unresolved.words(self.counts.completed)
        errored = self.errored.words(self.counts)
        return " ".join(filter(None, (missed, self.rate_note, unresolved, errored)))


MOST_BLOCKS = 1_000
"""Maximum number of blocks of a course."""


class BlockTotals(msgspec.Struct, frozen=True):
    """Sums over the completed episodes with an index from `first` to before the next block.

    Attributes:
        first: first index, a multiple of the block's length.
        completed: number of completed episodes, at least one.
        failures: number of failures among them.
        errored: number of episodes that errored.
        unresolved: number of safe episodes that are unresolved.
        log_probability: sum of log p over all steps of the failures.
        steps: number of steps of the failures.
        smallest_robustness_m: smallest robustness; None if robustness was not measured.
        median_robustness_m: median robustness; None if robustness was not measured.
    """

    first: int
    completed: int
    failures: int
    log_probability: float
    steps: int
    smallest_robustness_m: float | None
    median_robustness_m: float | None
    errored: int = 0
    unresolved: int = 0


class CourseBlock(msgspec.Struct, frozen=True, kw_only=True):
    """Figures of consecutive completed episodes of a campaign.

    Attributes:
        first: smallest index.
        last: largest index.
        failure_rate: failure rate over the completed episodes, with its interval.
        log_probability_per_step: log-probability per step of the failures: sum of log p over all
            their steps ÷ steps; None without a failure.
    """

    first: int
    last: int
    failure_rate: Rate
    log_probability_per_step: float | None
    smallest_robustness_m: float | None
    median_robustness_m: float | None


class Course(Brief, Shown, msgspec.Struct, frozen=True, kw_only=True):
    """Course of a campaign over its episodes.

    Attributes:
        heading: "Learning curve" for a method that learns, else "Failures over episodes".
        per: number of indices in a block.
        blocks: blocks in index order; blocks without a completed episode are left out.
    """

    campaign: int
    method: str
    heading: str
    per: int
    blocks: tuple[CourseBlock, ...]


MOST_SAMPLES = 2_000
"""Maximum number of episodes in a chart."""


class EpisodeSample(msgspec.Struct, frozen=True):
    """Outcome and robustness of a completed episode.

    Attributes:
        robustness_m: robustness; None if it was not measured. [m]
    """

    index: int
    outcome: Outcome
    robustness_m: float | None


MOST_LANDINGS = 200
"""Maximum number of points of a cost curve, without its ends."""


class StoredProgress(msgspec.Struct, frozen=True):
    """Progress of a campaign when a result was stored.

    Attributes:
        at_ms: time of storage, in milliseconds since 1970.
        completed: number of episodes completed until then, including this one.
        failures: number of failures among them.
    """

    at_ms: int
    completed: int
    failures: int


class SpendingTotals(msgspec.Struct, frozen=True):
    """Totals of the worker time in a campaign's episodes, from the store.

    Attributes:
        completed_worker_s: sum of `wall_s` over the completed episodes.
        errored_worker_s: sum of `wall_s` over the errored episodes.
        progress: every k-th completed episode and the last one, by time of storage, then by
            index.
    """

    completed_worker_s: float = 0.0
    errored_worker_s: float = 0.0
    progress: tuple[StoredProgress, ...] = ()


class CostPoint(msgspec.Struct, frozen=True, kw_only=True):
    """The findings of a campaign up to an amount of money spent.

    Attributes:
        usd: price per instance-hour × instance-hours until then.
        active_s: time during which the campaign had been running.
        completed: number of completed episodes.
        failures: number of failures among them.
        modes: number of distinct modes with a failure among them; None if modes are unknown.
    """

    usd: float
    active_s: float
    completed: int
    failures: int
    modes: int | None


class TimeSplit(msgspec.Struct, frozen=True, kw_only=True):
    """Breakdown of the time for which a campaign was billed; the five parts sum to `active_s`.

    Attributes:
        active_s: time during which the campaign was running.
        simulation_s: time with at least one episode at a worker, minus `lost_s`.
        startup_s: time of the learner's work without an episode at a worker, for a method that does
            not learn: it started, or proposed noise. 0 for a method that learns.
        learning_s: time of the learner's work without an episode at a worker, for a method that
            learns, its start included.
        waiting_s: time while no worker held an episode of the campaign and the learner did not
            work: the campaign waited for workers or for the database.
        lost_s: part of the time with episodes at workers that counts as lost: this time ×
            `lost_worker_s` ÷ (`worker_s` + `lost_worker_s`).
        worker_s: worker time in completed episodes, summed over all workers.
        lost_worker_s: worker time in errored episodes, in second results of an episode, and in
            results that the store did not accept.
    """

    active_s: float
    worker_s: float
    simulation_s: float
    startup_s: float
    learning_s: float
    waiting_s: float
    lost_s: float
    lost_worker_s: float


class CampaignCost(Brief, Shown, msgspec.Struct, frozen=True, kw_only=True):
    """Cost of a campaign, with the failures and modes found.

    Attributes:
        price_usd_per_hour: price of one instance.
        instances: number of instances that the campaign occupied while it ran.
        completed: number of completed episodes.
        failures: number of failures among them.
        cost: cost, total and per failure, with its interval or lower bound.
        analysis: id of the newest finished analysis of this campaign; None without one.
        modes: number of distinct modes with failures of the campaign; None if modes are unknown.
        per_mode_usd: total ÷ modes; None if modes are unknown.
        modes_in_words: number of modes with the reason, or why modes are unknown.
        curve: cost curve from nothing spent to everything, in order of time.
        time: breakdown of the time.
        notes: which figures are approximate, and why.
    """

    campaign: int
    name: str
    method: str
    price_usd_per_hour: float
    instances: int
    completed: int
    failures: int
    cost: Cost
    analysis: int | None
    modes: int | None
    per_mode_usd: float | None
    modes_in_words: str
    curve: tuple[CostPoint, ...]
    time: TimeSplit
    notes: tuple[str, ...] = ()
