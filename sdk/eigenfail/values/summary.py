"""What a campaign came to: the row of a result table."""

import msgspec

from eigenfail.values.campaign import Cost, Counts, Estimate, Rate
from eigenfail.values.showing import Shown


class MeanTime(msgspec.Struct, frozen=True):
    """A mean over n episodes [s]; None over none."""

    mean_s: float | None = None
    n: int = 0


class Conflicts(msgspec.Struct, frozen=True):
    """The completed episodes of a campaign by conflict class, and how early collisions showed.

    Attributes:
        unavoidable: collisions that braking could not avoid once they showed.
        planner_failures: collisions that it could.
        unclassified: collisions of which too little was measured to class them.
        near_misses: MinTTC < 1.5 s without a collision.
        ttc_lead: from the first violation of MinTTC to the collision.
        drac_lead: from the first violation of DRAC to the collision.
    """

    unavoidable: int = 0
    planner_failures: int = 0
    unclassified: int = 0
    near_misses: int = 0
    ttc_lead: MeanTime = MeanTime()
    drac_lead: MeanTime = MeanTime()


class Unresolved(msgspec.Struct, frozen=True):
    """Episodes that count as safe because they ended: braking could not avoid a collision any more.

    Attributes:
        count: how many; none of them is a failure.
        not_known: of how many this is not known: an older release measured too little.
        horizon_s: how long an episode without a collision lasts, the longest where that varies [s];
            None where steps have no duration, or the scenario is not known here.
    """

    count: int = 0
    not_known: int = 0
    horizon_s: float | None = None

    def words(self, completed: int) -> str:
        """In a sentence, of so many completed episodes; empty if there is nothing to tell."""
        within = "" if self.horizon_s is None else f" within {self.horizon_s:g} s"
        sure = f"{self.count:,} of {completed:,} had no collision{within}, but ended while braking"
        perhaps = f"{self.not_known:,} of {completed:,} without a collision{within} may have ended"
        told = {
            f"{sure} could not avoid one any more.": self.count,
            f"{perhaps} like that: an older release, which ran them, did not tell.": self.not_known,
        }
        return " ".join(words for words, count in told.items() if count)


class Errored(msgspec.Struct, frozen=True):
    """Episodes of a campaign that could not be completed, and their most frequent reason.

    Attributes:
        count: number of errored episodes; no rate counts them.
        kind: of the most frequent reason: infrastructure, simulator, planner, solver or input.
        reason: the most frequent reason, in words; of equally frequent ones the earliest.
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
            counts: of the same campaign; a rate counts its completed episodes alone.
        """
        if not self.count:
            return ""
        if counts.completed:
            total = self.count + counts.completed
            told = f"{self.count:,} of {total:,} episodes errored and are not counted in the rate"
        else:
            every = "The only episode" if self.count == 1 else f"All {self.count:,} episodes"
            so_far = " so far" if counts.open else ""
            told = f"{every}{so_far} errored, so there is no result"
        return f"{told}. {self.most_frequent}".strip()

    @property
    def most_frequent(self) -> str:
        """The most frequent reason in a sentence, with its kind; empty if it is not known."""
        if not self.times:
            return ""
        times = "" if self.times == self.count else f", {self.times:,} times"
        return f"Most frequent reason ({self.kind}{times}): {self.reason}"


class Summary(Shown, msgspec.Struct, frozen=True):
    """The row of a campaign in a result table.

    Attributes:
        failure_rate: collisions within the horizon ÷ completed episodes; None before the first one.
        mean_log_probability: of the failures, summed over their steps.
        log_probability_per_step: of the failures: sum of log p over all their steps ÷ steps.
        mean_severity: of the failures [m²/s²].
        estimate: of the failure probability under p(x); None where the method tells none, or none
            yet.
        unresolved: episodes that are no failures only because they ended.
        errored: episodes that could not be completed, with their most frequent reason.
        reach: of a campaign that ended without a failure: which disturbances its method cannot
            choose, and what to do; empty where the method can choose any.
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

    @property
    def remark(self) -> str:
        """What is to be known of the failure rate, in sentences; empty if there is nothing."""
        missed = f"No failure was found. {self.reach}" if self.reach else ""
        unresolved = self.unresolved.words(self.counts.completed)
        return " ".join(filter(None, (missed, unresolved, self.errored.words(self.counts))))
