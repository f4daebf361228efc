"""Safety measures over the episodes of a campaign, and the severity of its failures."""

import msgspec
import numpy as np
from numpy.typing import NDArray

from eigenfail.values.estimates import Interval, Rate
from eigenfail.values.records import ConflictClass
from eigenfail.values.showing import Brief, Shown
from eigenfail.values.summary import Conflicts, Unresolved

MOST_POINTS = 2_000
"""Maximum number of failures in a scatter."""

TAIL_LEVEL = 0.95
"""Level of VaR and CVaR, unless another one is requested."""


class MeasureTotals(msgspec.Struct, frozen=True):
    """A measure over the completed episodes that have one.

    Attributes:
        n: number of episodes with the measure. An episode that never closed in on a vehicle has
            neither MinTTC nor DRAC.
        violations: number of episodes beyond the threshold.
        median: median, the mean of the two middle values of an even number; None if n is 0.
        worst: the smallest MinTTC, or the largest DRAC; None if n is 0.
    """

    n: int = 0
    violations: int = 0
    median: float | None = None
    worst: float | None = None


class FailurePoint(msgspec.Struct, frozen=True):
    """A failure by likelihood and severity.

    Attributes:
        index: index of the episode.
        log_probability_per_step: sum of log p over its steps ÷ steps.
        severity: severity of the collision [m²/s²].
        conflict: conflict class; None if too little was measured.
    """

    index: int
    log_probability_per_step: float
    severity: float
    conflict: ConflictClass | None


class RequirementTotals(msgspec.Struct, frozen=True):
    """A requirement over the completed episodes.

    Attributes:
        n: number of episodes judged by it.
        violations: number of episodes that violate it.
        worst: smallest robustness, in the unit of the requirement; None if n is 0.
    """

    n: int
    violations: int
    worst: float | None


class SafetyTotals(msgspec.Struct, frozen=True, eq=False):
    """Totals over a campaign's completed episodes for its safety measures, from the store.

    Attributes:
        completed: number of completed episodes.
        failures: number of failures among them.
        ttc: distribution of MinTTC [s].
        drac: distribution of the largest DRAC [m/s²].
        severities: severities of the failures that have one, in index order, shape (n,). [m²/s²]
        points: every k-th failure with a severity, in index order.
        requirements: totals of each requirement that the campaign names, in their order.
    """

    completed: int
    failures: int
    ttc: MeasureTotals
    drac: MeasureTotals
    severities: NDArray[np.float64]
    points: tuple[FailurePoint, ...]
    requirements: tuple[RequirementTotals, ...] = ()


class SeveritySample(msgspec.Struct, frozen=True):
    """The severities of a campaign's failures: all of them, or only after burn-in.

    Attributes:
        failures: number of failures.
        severities: severities of the failures that have one, in index order. [m²/s²]
    """

    failures: int
    severities: tuple[float, ...]


class Violations(msgspec.Struct, frozen=True, kw_only=True):
    """A measure over the completed episodes that have one; a row of the paper's table.

    Attributes:
        threshold: limit of a violation: values below it for MinTTC, above it for DRAC.
        beyond: episodes beyond the threshold ÷ completed episodes; None before the first completed
            episode, or if the campaign lacks the measure.
        n: number of episodes with the measure; median and worst are over these episodes.
        worst: the smallest MinTTC, or the largest DRAC.
    """

    threshold: float
    beyond: Rate | None
    n: int
    median: float | None
    worst: float | None


class RequirementFigures(msgspec.Struct, frozen=True, kw_only=True):
    """A requirement over the completed episodes.

    Attributes:
        number: place of the requirement in the campaign, from 1. If it is the first one that an
            episode violates, this number is the episode's `violated`.
        name: name of the requirement.
        words: the requirement in words.
        unit: unit of its robustness; empty for none.
        violations: episodes that violate it ÷ episodes judged by it; None before the first judged
            episode. An episode may violate several requirements.
        worst: smallest robustness; None before the first judged episode.
    """

    number: int
    name: str
    words: str
    unit: str
    violations: Rate | None
    worst: float | None


class Figure(msgspec.Struct, frozen=True):
    """A number with its 95 % interval; the interval is None if too little is known for one."""

    value: float
    interval: Interval | None = None


class SeverityRisk(msgspec.Struct, frozen=True, kw_only=True):
    """How severe the failures are: on average, and at their worst.

    Attributes:
        level: level of VaR and CVaR.
        n: number of failures behind the figures.
        beyond: number of failures that the level leaves above VaR: n · (1 − level).
        mean: mean severity; None without a failure.
        var: value at risk: the smallest severity that a share `level` of the failures does not
            exceed; None if too few are beyond it.
        cvar: conditional value at risk: the mean of the worst share 1 − level; None with `var`.
        problem: why a number or an interval is missing, and what to do; empty otherwise.
    """

    level: float
    n: int
    beyond: float
    mean: Figure | None = None
    var: Figure | None = None
    cvar: Figure | None = None
    problem: str = ""


class Scatter(msgspec.Struct, frozen=True):
    """Likelihood against severity.

    Attributes:
        points: points in the order of the episodes.
        of: number of failures that the points represent; if this exceeds the number of points,
            every k-th failure is shown.
        rank_correlation: Spearman's ρ over the points: below 0 if severe failures are rarer;
            None over fewer than ten points, or if one axis does not vary.
    """

    points: tuple[FailurePoint, ...]
    of: int
    rank_correlation: Figure | None = None


class Safety(Brief, Shown, msgspec.Struct, frozen=True, kw_only=True):
    """The safety measures of a campaign (paper, section on safety measures).

    Attributes:
        failures: failures ÷ completed episodes; all shares are None before the first completed
            episode.
        collisions: collisions ÷ completed episodes, including collisions that no requirement
            forbids; equal to `failures` unless requirements are named.
        near_misses: MinTTC < 1.5 s without a collision ÷ completed episodes. Also None if the
            system under test is a function, as are the shares of `ttc` and `drac`.
        conflicts: unavoidable versus planner failures, and the mean lead times.
        unresolved: episodes without a collision only because they ended.
        ttc: distribution of MinTTC [s].
        drac: distribution of the largest DRAC [m/s²].
        severity: severity of the failures [m²/s²], each counted once, however likely it is under
            p(x).
        scatter: likelihood against severity of the failures.
        requirements: figures of each requirement that the campaign names, in their order; empty if
            it names none.
        notes: limitations of the numbers.
    """

    campaign: int
    name: str
    method: str
    completed: int
    failures: Rate | None
    collisions: Rate | None
    near_misses: Rate | None
    conflicts: Conflicts
    ttc: Violations
    drac: Violations
    severity: SeverityRisk
    scatter: Scatter
    unresolved: Unresolved = Unresolved()
    requirements: tuple[RequirementFigures, ...] = ()
    notes: tuple[str, ...] = ()

    @property
    def measures_traffic(self) -> bool:
        """True if episodes have times to collision and classes, unlike episodes of a function."""
        return self.near_misses is not None or not self.completed
