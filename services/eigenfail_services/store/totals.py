"""Sums over the episodes of campaigns, made by the database."""

from collections.abc import Sequence
from typing import NamedTuple

from msgspec.structs import replace
from sqlalchemy import Connection, Row, and_, func, null, or_, select

from eigenfail.values import Outcome
from eigenfail.values.assessment import NEAR_MISS_TTC_S, PEAK_BRAKING_MPS2
from eigenfail.values.records import ConflictTotals, Totals
from eigenfail_services.store.schema import campaigns, episodes

SUMMED = tuple(
    episodes.c[name]
    for name in (
        *("campaign", "index", "log_probability", "steps", "severity", "collided_s"),
        *("ttc_violated_s", "drac_violated_s", "drac_at_warning_mps2"),
    )
)
"""An index holds just these."""


class Ended(NamedTuple):
    """Episodes whose end was unresolved, and those of which that is not known."""

    unresolved: int
    perhaps: int


NOBODY = Ended(0, 0)


def results(connection: Connection, chosen: Sequence[int]) -> dict[int, int]:
    """How many results each of some campaigns has; those that do not exist are left out."""
    query = select(campaigns.c.id, campaigns.c.completed + campaigns.c.failed)
    found = connection.execute(query.where(campaigns.c.id.in_(chosen)))
    return {row[0]: row[1] for row in found}


def totals(connection: Connection, chosen: Sequence[int]) -> dict[int, Totals]:
    """Sums over all collisions, and episodes counted by class, as `assess` classifies them.

    Three questions, however many campaigns.
    """
    # In index order: sums of floats depend on theirs, and reports must not change with it.
    collisions = (
        select(*SUMMED)
        .where(episodes.c.campaign.in_(chosen), episodes.c.outcome == Outcome.COLLISION)
        .order_by(episodes.c.campaign, episodes.c["index"])
        .subquery()
        .c
    )
    classified = collisions.collided_s.is_not(None)
    hopeless = or_(
        collisions.drac_at_warning_mps2.is_(None),
        collisions.drac_at_warning_mps2 > PEAK_BRAKING_MPS2,
    )
    ttc_lead_s = collisions.collided_s - collisions.ttc_violated_s
    drac_lead_s = collisions.collided_s - collisions.drac_violated_s
    query = select(
        collisions.campaign,
        func.count().label("failures"),
        func.coalesce(func.sum(collisions.log_probability), 0.0).label("log_probability"),
        func.coalesce(func.sum(collisions.steps), 0).label("steps"),
        func.sum(collisions.severity).label("severity"),
        func.count().filter(and_(classified, hopeless)).label("unavoidable"),
        func.count().filter(~classified).label("unclassified"),
        func.coalesce(func.sum(ttc_lead_s), 0.0).label("ttc_lead_s"),
        func.count(ttc_lead_s).label("ttc_leads"),
        func.coalesce(func.sum(drac_lead_s), 0.0).label("drac_lead_s"),
        func.count(drac_lead_s).label("drac_leads"),
    ).group_by(collisions.campaign)
    crashes = {found.campaign: found for found in connection.execute(query)}
    near, ended = near_misses(connection, chosen), unresolved(connection, chosen)
    return {
        campaign: totals_of(
            crashes.get(campaign), near.get(campaign, 0), ended.get(campaign, NOBODY)
        )
        for campaign in chosen
    }


def totals_of(found: Row[*tuple[object, ...]] | None, near: int, ended: Ended) -> Totals:
    """From the sums over a campaign's collisions, where it has one, and what else was near."""
    safe = ConflictTotals(
        near_misses=near, unresolved=ended.unresolved, perhaps_unresolved=ended.perhaps
    )
    if found is None:
        return Totals(0, 0.0, 0, None, safe)
    return Totals(
        failures=found.failures,
        log_probability=found.log_probability,
        steps=found.steps,
        severity=found.severity,
        conflicts=replace(
            safe,
            unavoidable=found.unavoidable,
            planner_failures=found.failures - found.unavoidable - found.unclassified,
            unclassified=found.unclassified,
            ttc_lead_s=found.ttc_lead_s,
            ttc_leads=found.ttc_leads,
            drac_lead_s=found.drac_lead_s,
            drac_leads=found.drac_leads,
        ),
    )


def near_misses(connection: Connection, chosen: Sequence[int]) -> dict[int, int]:
    """How many episodes came near without a collision; an index holds just these."""
    query = (
        select(episodes.c.campaign, func.count())
        .where(
            episodes.c.campaign.in_(chosen),
            episodes.c.outcome == Outcome.SAFE,
            episodes.c.min_ttc_s < NEAR_MISS_TTC_S,
        )
        .group_by(episodes.c.campaign)
    )
    return {row[0]: row[1] for row in connection.execute(query)}


def unresolved(connection: Connection, chosen: Sequence[int]) -> dict[int, Ended]:
    """How many episodes ended while braking could not avoid a collision any more, as `assess` says.

    The largest DRAC is no smaller than the last: an index leads to the few that come into question.
    """
    last = episodes.c.final_drac_mps2
    query = (
        select(
            episodes.c.campaign,
            func.count().filter(last > PEAK_BRAKING_MPS2),
            func.count().filter(last.is_(None)),
        )
        .where(
            episodes.c.campaign.in_(chosen),
            episodes.c.max_drac_mps2 > PEAK_BRAKING_MPS2,
            # Without statistics SQLite would take the index of outcomes, and read every safe row.
            func.coalesce(episodes.c.outcome, null()) == Outcome.SAFE,
        )
        .group_by(episodes.c.campaign)
    )
    return {row[0]: Ended(row[1], row[2]) for row in connection.execute(query)}
