"""The sections of a report, one module each, in the order in which they are read.

A section's `part` takes the `Material` and returns a `Part`, or None where it has nothing to say.
"""

from collections.abc import Callable

from eigenfail_services.reports.material import Material
from eigenfail_services.reports.parts import Part
from eigenfail_services.reports.sections import (
    collisions,
    cost,
    eigenfailures,
    influence,
    learning,
    likelihood,
    minimal,
    modes,
    proof,
    provenance,
    region,
    results,
    safety,
    setup,
    training,
    variance,
)

MakePart = Callable[[Material], Part | None]

PARTS: tuple[MakePart, ...] = (
    results.part,
    setup.part,
    safety.part,
    learning.part,
    likelihood.part,
    cost.part,
    modes.part,
    eigenfailures.part,
    proof.part,
    minimal.part,
    collisions.part,
    influence.part,
    variance.part,
    training.part,
    region.part,
    provenance.part,
)
