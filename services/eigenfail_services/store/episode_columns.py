"""The columns that episodes can be filtered and sorted by, as SQL."""

from collections.abc import Iterator
from typing import Any

from sqlalchemy import ColumnElement, Text, case, func, literal, null, or_, type_coerce

from eigenfail.filters import COMPARE, Condition, Conditions, Operator, Sort, Value
from eigenfail.values import ConflictClass, Outcome
from eigenfail.values.assessment import NEAR_MISS_TTC_S, PEAK_BRAKING_MPS2
from eigenfail_services.store.schema import Number, Prose, episodes

Expression = ColumnElement[Any]

c = episodes.c
COLLIDED = c.outcome == Outcome.COLLISION
HOPELESS = or_(c.drac_at_warning_mps2.is_(None), c.drac_at_warning_mps2 > PEAK_BRAKING_MPS2)

CLASS = case(
    (c.robustness_m.is_(None), null()),
    ((c.outcome == Outcome.SAFE) & (c.min_ttc_s < NEAR_MISS_TTC_S), ConflictClass.NEAR_MISS.value),
    (c.outcome == Outcome.SAFE, ConflictClass.NONE.value),
    (c.collided_s.is_(None), null()),
    (COLLIDED & HOPELESS, ConflictClass.UNAVOIDABLE.value),
    (COLLIDED, ConflictClass.PLANNER_FAILURE.value),
)
"""As `assess` classifies episodes."""

DERIVED: dict[str, Expression] = {
    "class": type_coerce(CLASS, Text()),
    "ttc_lead_s": case((COLLIDED, c.collided_s - c.ttc_violated_s)),
    "drac_lead_s": case((COLLIDED, c.collided_s - c.drac_violated_s)),
    "log_probability_per_step": c.log_probability / case((c.steps > 0, c.steps), else_=1),
    "problem": type_coerce(
        c.fault_kind + literal(": ") + func.coalesce(c.fault_message, ""), Prose()
    ),
}
"""What is worked out from a row rather than stored in it."""


def expression(column: str) -> Expression:
    """A column by its name in filters."""
    return DERIVED[column] if column in DERIVED else c[column]


def fulfilled(where: Conditions, sort: Sort) -> Iterator[Expression]:
    """The conditions, so that the database goes along the order and not along one of them."""
    for condition in where:
        column = expression(condition.column)
        leads = leads_the_way(condition, sort)
        # SQLite, which knows nothing of how many rows match, would take any index for a condition
        # and then sort what it found, for every page anew.
        compared = column if leads else func.coalesce(column, null(), type_=column.type)
        yield COMPARE[condition.operator](compared, bound(condition.value))


def bound(value: Value) -> Any:
    """A value to compare with; a whole number may be larger than those of its column."""
    return literal(value, Number()) if type(value) is int else value


def leads_the_way(condition: Condition, sort: Sort) -> bool:
    """Whether an index holds what a condition wants in the wanted order."""
    of_one_outcome = condition.column == "outcome" and condition.operator is Operator.EQUAL
    return condition.column == sort.column or (sort.column == "index" and of_one_outcome)
