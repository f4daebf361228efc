"""The safety measures of a campaign's episodes together, and how severe its failures are."""

import msgspec
import numpy as np
from numpy.typing import NDArray

from eigenfail.values.estimates import Interval, Rate
from eigenfail.values.records import ConflictClass
from eigenfail.values.showing import Brief, Shown
from eigenfail.values.summary import Conflicts, Unresolved

MOST_POINTS = 2_000
"""How many failures a scatter shows at most."""

TAIL_LEVEL = 0.95
"""Level of VaR and CVaR, unless another one is requested."""


class MeasureTotals(msgspec.Struct, frozen=True):
    """A measure over the completed episodes that have one.

    Attributes:
        n: how many have it: one that never closed in on anybody has neither MinTTC nor DRAC.
        violations: how many are beyond the threshold.
        median: median, the mean of the two middle values of an even number; None over none.
        worst: the smallest MinTTC, or the largest DRAC; None over none.
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
        severity: [m²/s²].
        conflict: its class; None if too little was measured.
    """

    index: int
    log_probability_per_step: float
    severity: float
    conflict: ConflictClass | None


class RequirementTotals(msgspec.Struct, frozen=True):
    """A requirement over the completed episodes.

    Attributes:
        n: how many were judged by it.
        violations: how many of them violate it.
        worst: smallest robustness, in the unit of the requirement; None if none was judged.
    """

    n: int
    violations: int
    worst: float | None


class SafetyTotals(msgspec.Struct, frozen=True, eq=False):
    """What the store makes of a campaign's completed episodes for its safety measures.

    Attributes:
        completed: episodes.
        failures: failures among them.
        ttc: distribution of MinTTC [s].
        drac: distribution of the largest DRAC [m/s²].
        severities: severities of the failures that have one, in index order, shape (n,). [m²/s²]
        points: every k-th of those failures, in index order.
        requirements: of each requirement that the campaign names, in their order.
    """

    completed: int
    failures: int
    ttc: MeasureTotals
    drac: MeasureTotals
    severities: NDArray[np.float64]
    points: tuple[FailurePoint, ...]
    requirements: tuple[RequirementTotals, ...] = ()


class SeveritySample(msgspec.Struct, frozen=True):
    """The severities of a campaign's failures, all or those after burn-in.

    Attributes:
        failures: number of failures.
        severities: severities of those that have one, in index order. [m²/s²]
    """

    failures: int
    severities: tuple[float, ...]


class Violations(msgspec.Struct, frozen=True, kw_only=True):
    """A measure over the completed episodes that have one; a row of the paper's table.

    Attributes:
        threshold: limit of a violation: values below it for MinTTC, above it for DRAC.
        beyond: episodes beyond it ÷ completed episodes; None before the first one, and where it
            is not measured.
        n: how many episodes have the measure; median and worst are over these.
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
        number: its place in the campaign, from 1: episodes that violate it first have it as
            `violated`.
        name: its name.
        words: what it requires.
        unit: unit of its robustness; empty for none.
        violations: episodes that violate it ÷ episodes that were judged by it; None before the
            first one. An episode may violate several.
        worst: smallest robustness; None before the first of these episodes.
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
        n: failures that it rests on.
        beyond: how many of them the level leaves above VaR: n · (1 − level).
        mean: None without a failure.
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
        of: how many failures they stand for; if there are more than points, every k-th is shown.
        rank_correlation: Spearman's ρ over the points: below 0 if the severe are the rarer;
            None over fewer than ten points, or if one axis does not vary.
    """

    points: tuple[FailurePoint, ...]
    of: int
    rank_correlation: Figure | None = None


class Safety(Brief, Shown, msgspec.Struct, frozen=True, kw_only=True):
    """The safety measures of a campaign (paper, section on safety measures).

    Attributes:
        failures: failures ÷ completed episodes; None before the first one, as the other shares.
        collisions: collisions ÷ completed episodes, also those that no requirement forbids: the
            same, unless requirements are named.
        near_misses: MinTTC < 1.5 s without a collision ÷ completed episodes; None too where the
            system under test is a function, as the shares of `ttc` and `drac`.
        conflicts: unavoidable versus planner failures, and the mean lead times.
        unresolved: episodes that are no collisions only because they ended.
        ttc: distribution of MinTTC [s].
        drac: distribution of the largest DRAC [m/s²].
        severity: severity of the failures [m²/s²], each counted once, however likely it is under
            p(x).
        scatter: likelihood against severity of the failures.
        requirements: of each requirement that the campaign names, in their order; none if only
            no collision is required.
        notes: what the numbers cannot know.
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
        """Whether episodes have times to collision and classes: those of a function have none."""
        return self.near_misses is not None or not self.completed
