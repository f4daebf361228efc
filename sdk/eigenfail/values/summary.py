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


class Summary(Shown, msgspec.Struct, frozen=True):
    """The row of a campaign in a result table.

    Attributes:
        failure_rate: collisions ÷ completed episodes; None before the first one.
        mean_log_probability: of the failures, summed over their steps.
        log_probability_per_step: of the failures: sum of log p over all their steps ÷ steps.
        mean_severity: of the failures [m²/s²].
        estimate: of the failure probability under p(x); None where the method tells none, or none
            yet.
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
