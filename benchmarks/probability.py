"""Figure: the failure probability of a planner by subset simulation."""

from collections.abc import Iterator

import numpy as np
from crew import Crew, horizon, staged
from figures import Figure
from samples import COMMAND

from eigenfail_services.statistics.subset_simulation import (
    Array,
    SubsetEstimate,
    SubsetSettings,
    subset_simulation,
)

SETTINGS = SubsetSettings(samples=10_000)
"""At 2000 a level the estimate depends on whether one of the few lineages that fail is found."""


def p_fail(scenario: str, crew: Crew, seed: int) -> Iterator[tuple[str, Figure]]:
    """P(failure) of `rulebook` at a scenario's defaults."""
    found = estimate(scenario, crew, SETTINGS, seed)
    ends = found.interval and (found.interval.low, found.interval.high)
    yield (
        f"{scenario}.rulebook.p_fail",
        Figure(
            value=found.probability,
            unit="probability",
            n=found.evaluations,
            interval=ends,
            note=story(found),
            command=COMMAND,
        ),
    )


def estimate(scenario: str, crew: Crew, settings: SubsetSettings, seed: int) -> SubsetEstimate:
    """A subset simulation whose evaluations are episodes."""
    setup = staged(scenario, "rulebook")

    def robustness(z: Array) -> Array:
        return np.array([one.measures.robustness_m for one in crew.inject(setup, z)])

    return subset_simulation(robustness, horizon(scenario), settings, seed)


def story(found: SubsetEstimate) -> str:
    """How the estimate came about."""
    levels = ", ".join(f"{one.threshold:.3g}" for one in found.levels)
    return (
        f"subset simulation, {SETTINGS.samples} samples on a level, levels at {levels} m: "
        f"{found.end}, from {found.ancestors} first samples; "
        f"coefficient of variation {found.variation:.2f}"
    )
