"""What an analysis says besides components and modes."""

import msgspec

from eigenfail.values.arrays import Floats
from eigenfail.values.campaign import Interval

STABLE = 0.8
"""Adjusted Rand index below which clusters are not called modes: above it a partition is recovered
well, below 0.65 poorly (Steinley 2004, Psychological Methods 9, 386–396)."""


class AnalysedCampaign(msgspec.Struct, frozen=True, kw_only=True):
    """A campaign as it stood when its failures were analysed.

    Attributes:
        episodes: how many had ended, failures or not.
        failures: how many of them were analysed.
        running: whether more were to come: the analysis is of a snapshot then.
    """

    campaign: int
    episodes: int
    failures: int
    running: bool = False


class Stability(msgspec.Struct, frozen=True):
    """Whether the clusters come back when the failures are drawn again, with replacement.

    Attributes:
        resamples: how often they were drawn.
        rows: how many failures each draw has.
        median: of the adjusted Rand index (Hubert and Arabie 1985) between the clusters and those
            of a draw: 1 where they are the same, 0 as by chance.
        interval: from the 2.5 % to the 97.5 % quantile of the index over the draws.
    """

    resamples: int
    rows: int
    median: float
    interval: Interval


class Moment(msgspec.Struct, frozen=True):
    """A step at which noise matters most.

    Attributes:
        axis: "longitudinal" or "lateral".
        step: row of `influence`, in the alignment of the analysis.
        before_collision_s: time from the step to the collision; with alignment at the start to
            that of the median failure. None where steps have no duration. [s]
        influence: of this step, as in `influence`.
    """

    axis: str
    step: int
    before_collision_s: float | None
    influence: float


class InfluenceShare(msgspec.Struct, frozen=True, kw_only=True):
    """How much of the influence lies in the last time before the collision.

    Always of failures aligned at the collision, and over the time that half of them last: the
    shares would be equal if no time mattered more than another.

    Attributes:
        seconds: how long before the collision the time begins. [s]
        time: its share of the time.
        longitudinal: its share of the longitudinal influence; None where there is none.
        lateral: the same of the lateral influence.
        both: its share of all of it.
    """

    seconds: float
    time: float
    longitudinal: float | None
    lateral: float | None
    both: float | None


class TrainingInterval(msgspec.Struct, frozen=True, eq=False, kw_only=True):
    """The failures of a tenth of each campaign's episodes.

    Attributes:
        start: where the interval begins, as a share of the episodes.
        end: where it ends.
        failures: how many there are in it.
        mean: of z over them, shape (steps, 2); zeros without a failure. [sigma]
        components: of them alone, each turned towards the one of the same number of all failures,
            shape (at most 3, steps, 2).
        explained: share of their variance that each explains.
        likeness: |cosine| between each and the one of the same number of all failures.
    """

    start: float
    end: float
    failures: int
    mean: Floats
    components: Floats
    explained: Floats
    likeness: Floats
