"""Whether the chains of a campaign have mixed, with the reason in words."""

from collections.abc import Iterator, Sequence
from math import isnan

import numpy as np
from numpy.typing import NDArray

from eigenfail.values.estimates import ProjectionMixing
from eigenfail_searches.chains.mixing import FEWEST_DRAWS, compute_bulk_ess, compute_r_hat

LARGEST_R_HAT = 99.0
"""Stated of chains that differ and do not move at all: JSON has no infinity."""

MOST_R_HAT = 1.05
"""Vehtari et al. 2021 recommend 1.01 (section 4.4). Every draw costs an episode here: at 1.05 the
variance between chains still is a tenth of that within them."""

FEWEST_EFFECTIVE = 100.0
"""A share of 5 % of the failures is then known to ± 4 %. Vehtari et al. recommend 400."""

STARTS = (
    "Regions of failures between which no chain moves have the shares of the starts, not those of "
    "p(z | failure), and a region without a start is missing."
)


def measure_projections(
    names: Sequence[str], trace: NDArray[np.float32]
) -> tuple[ProjectionMixing, ...]:
    """Return R-hat and effective sample size by projection, those of the largest R-hat first.

    A projection that is unknown or the same in all draws is left out.

    Args:
        names: of the projections.
        trace: shape (draws, chains, projections).
    """
    if len(trace) < FEWEST_DRAWS:
        return ()
    columns = np.moveaxis(trace.astype(np.float64), 2, 0)
    known = [
        ProjectionMixing(name, min(r_hat, LARGEST_R_HAT), compute_bulk_ess(draws))
        for name, draws in zip(names, columns, strict=True)
        if not np.isnan(draws).any() and not isnan(r_hat := compute_r_hat(draws))
    ]
    return tuple(sorted(known, key=lambda one: (-one.r_hat, one.effective)))


def _list_shortfalls(projections: Sequence[ProjectionMixing]) -> Iterator[str]:
    """Yield why chains have not mixed; nothing if they have."""
    worst, fewest = projections[0], min(projections, key=lambda one: one.effective)
    if worst.r_hat >= MOST_R_HAT:
        yield (
            f"R-hat of {worst.name} is {worst.r_hat:.2f}; below {MOST_R_HAT:g} the chains agree."
        )
    if fewest.effective < FEWEST_EFFECTIVE:
        yield (
            f"The samples are worth {fewest.effective:.0f} independent ones by {fewest.name}; "
            f"{FEWEST_EFFECTIVE:.0f} are needed."
        )


def judge_projections(projections: Sequence[ProjectionMixing]) -> tuple[bool, str]:
    """Return whether chains have mixed, and the reason in words."""
    if not projections:
        return False, f"Not known yet: each chain needs {FEWEST_DRAWS} moves after burn-in."
    if shortfall := next(_list_shortfalls(projections), ""):
        return False, f"Not mixed. {shortfall} Give the campaign more episodes."
    return True, "Mixed: no projection shows from which failure a chain started."
