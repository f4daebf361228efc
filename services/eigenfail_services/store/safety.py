"""Safety measures over the episodes of a campaign, made by the database."""

from math import ceil

import numpy as np
from numpy.typing import NDArray
from sqlalchemy import ColumnElement, Connection, func, select

from eigenfail.values import FailurePoint, MeasureTotals, Outcome, SafetyTotals
from eigenfail.values.assessment import NEAR_MISS_TTC_S, PEAK_BRAKING_MPS2
from eigenfail_services.store.blocks import median
from eigenfail_services.store.codec import to_row
from eigenfail_services.store.episode_pages import Rows, number
from eigenfail_services.store.schema import episodes

CHUNK = 10_000
"""How many severities are fetched at a time."""


def safety(connection: Connection, campaign: int, most: int) -> SafetyTotals:
    """Measures of the completed episodes; of failures, every severity and at most so many points.

    What grows with the campaign here is eight bytes for each failure.
    """
    ttc, drac = episodes.c.min_ttc_s, episodes.c.max_drac_mps2
    count = completed(campaign).with_only_columns(
        func.count().label("all"),
        func.count().filter(episodes.c.outcome == Outcome.COLLISION).label("failures"),
        func.count(ttc).label("ttc_n"),
        func.count().filter(ttc < NEAR_MISS_TTC_S).label("ttc_beyond"),
        func.min(ttc).label("ttc_worst"),
        func.count(drac).label("drac_n"),
        func.count().filter(drac > PEAK_BRAKING_MPS2).label("drac_beyond"),
        func.max(drac).label("drac_worst"),
    )
    found = connection.execute(count).one()
    severities = severities_of(connection, campaign)
    return SafetyTotals(
        completed=found.all,
        failures=found.failures,
        ttc=MeasureTotals(
            found.ttc_n,
            found.ttc_beyond,
            median(connection, completed(campaign), ttc, found.ttc_n),
            found.ttc_worst,
        ),
        drac=MeasureTotals(
            found.drac_n,
            found.drac_beyond,
            median(connection, completed(campaign), drac, found.drac_n),
            found.drac_worst,
        ),
        severities=severities,
        points=points(connection, campaign, ceil(len(severities) / most)),
    )


def completed(campaign: int) -> Rows:
    """The completed episodes."""
    return select(episodes).where(
        episodes.c.campaign == campaign, episodes.c.outcome != Outcome.FAILED
    )


def severe(campaign: int) -> tuple[ColumnElement[bool], ...]:
    """What makes an episode a failure with a severity."""
    return (
        episodes.c.campaign == campaign,
        episodes.c.outcome == Outcome.COLLISION,
        episodes.c.severity.is_not(None),
    )


def severities_of(connection: Connection, campaign: int) -> NDArray[np.float64]:
    """The severity of every failure that has one, in index order."""
    query = select(episodes.c.severity).where(*severe(campaign)).order_by(number)
    streamed = connection.execute(query.execution_options(yield_per=CHUNK)).scalars()
    return np.fromiter(streamed, np.float64)


def points(connection: Connection, campaign: int, every: int) -> tuple[FailurePoint, ...]:
    """Every so-manyth failure with a severity, in index order, from the first one on."""
    if not every:
        return ()
    place = func.row_number().over(order_by=number).label("place")
    ranked = select(*episodes.c, place).where(*severe(campaign)).subquery()
    query = (
        select(*(ranked.c[column.name] for column in episodes.c))
        .where((ranked.c.place - 1) % every == 0)
        .order_by(ranked.c["index"])
    )
    rows = (to_row(found) for found in connection.execute(query).mappings())
    return tuple(
        FailurePoint(
            row.index, row.log_probability / max(row.steps, 1), row.severity, row.assessed.conflict
        )
        for row in rows
        if row.severity is not None
    )
