"""The sections of a report, in the order in which they are read.

Each function takes the `Material` and returns a `Part`, or None where there is nothing to say.
"""

from collections.abc import Callable

from eigenfail_services.reports.material import Material
from eigenfail_services.reports.page import ReportPart
from eigenfail_services.reports.sections import (
    causes,
    costs,
    courses,
    evidence,
    failure_modes,
    outcomes,
)

MakePart = Callable[[Material], ReportPart | None]

PARTS: tuple[MakePart, ...] = (
    outcomes.make_results,
    outcomes.make_setup,
    courses.make_safety,
    courses.make_learning,
    courses.make_likelihood,
    costs.make_cost,
    failure_modes.make_modes,
    failure_modes.make_eigenfailures,
    evidence.make_proof,
    costs.make_minimal,
    causes.make_collisions,
    causes.make_influence,
    evidence.make_variance,
    evidence.make_training,
    costs.make_region,
    outcomes.make_provenance,
)
