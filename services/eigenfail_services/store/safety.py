"""Safety measures over the episodes of a campaign."""

from collections.abc import Sequence
from math import ceil
from statistics import fmean
from typing import Any, NamedTuple

from sqlalchemy import ColumnElement, Connection, Select, func, select

from eigenfail.values import FailurePoint, MeasureTotals, Outcome, SafetyTotals
from eigenfail.values.assessment import NEAR_MISS_TTC_S, PEAK_BRAKING_MPS2
from eigenfail_services.store.codec import to_row
from eigenfail_services.store.columns import COLLIDED, columns
from eigenfail_services.store.episode_pages import number
from eigenfail_services.store.schema import episodes


def safety(connection: Connection, campaign: int, most: int) -> SafetyTotals:
    """Measures of the completed episodes; of failures, every severity and at most so many points.

    What grows with the campaign here is two numbers for each failure.
    """
    done = select(func.count(), func.sum(COLLIDED)).where(*completed(campaign))
    count, failures = connection.execute(done).one()
    crashed, severities = columns(connection, severe(campaign))
    every = max(1, ceil(len(crashed) / most))
    return SafetyTotals(
        completed=count,
        failures=failures or 0,
        ttc=measure(connection, campaign, TTC),
        drac=measure(connection, campaign, DRAC),
        severities=severities,
        points=points(connection, campaign, crashed[::every].astype(int).tolist()),
    )


def completed(campaign: int) -> tuple[ColumnElement[bool], ...]:
    """What makes an episode a completed one."""
    return episodes.c.campaign == campaign, episodes.c.outcome != Outcome.FAILED


class Measured(NamedTuple):
    """A measure, what is beyond its threshold, and its worst value."""

    column: ColumnElement[float]
    beyond: ColumnElement[bool]
    worst: ColumnElement[float]


TTC = Measured(
    episodes.c.min_ttc_s,
    episodes.c.min_ttc_s < NEAR_MISS_TTC_S,
    func.min(episodes.c.min_ttc_s),
)
DRAC = Measured(
    episodes.c.max_drac_mps2,
    episodes.c.max_drac_mps2 > PEAK_BRAKING_MPS2,
    func.max(episodes.c.max_drac_mps2),
)


def measure(connection: Connection, campaign: int, of: Measured) -> MeasureTotals:
    """A measure over the completed episodes that have it; an index holds them in its order."""
    inside = (*completed(campaign), of.column.is_not(None))
    query = select(func.count(), func.count().filter(of.beyond), of.worst).where(*inside)
    count, beyond, worst = connection.execute(query).one()
    if not count:
        return MeasureTotals()
    middle = (
        select(of.column)
        .where(*inside)
        .order_by(of.column)
        .offset((count - 1) // 2)
        .limit(2 - count % 2)
    )
    return MeasureTotals(count, beyond, fmean(connection.execute(middle).scalars()), worst)


def severe(campaign: int) -> Select[*tuple[Any, ...]]:
    """Index and severity of every failure that has one, in index order."""
    return (
        select(number, episodes.c.severity)
        .where(
            episodes.c.campaign == campaign,
            episodes.c.outcome == Outcome.COLLISION,
            episodes.c.severity.is_not(None),
        )
        .order_by(number)
    )


def points(
    connection: Connection, campaign: int, chosen: Sequence[int]
) -> tuple[FailurePoint, ...]:
    """Some failures by likelihood and severity, in index order."""
    query = select(episodes).where(episodes.c.campaign == campaign, number.in_(chosen))
    rows = map(to_row, connection.execute(query.order_by(number)).mappings())
    return tuple(
        FailurePoint(
            row.index, row.log_probability / max(row.steps, 1), row.severity, row.assessed.conflict
        )
        for row in rows
        if row.severity is not None
    )
