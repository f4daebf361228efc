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

    @property
    def remark(self) -> str:
        """What is to be known of the failure rate, in a sentence; empty if there is nothing."""
        return self.unresolved.words(self.counts.completed)
