"""Sums over the episodes of a campaign, made by the database."""

from sqlalchemy import Connection, and_, func, or_, select

from eigenfail.values import Outcome
from eigenfail.values.assessment import NEAR_MISS_TTC_S, PEAK_BRAKING_MPS2
from eigenfail.values.records import ConflictTotals, Totals
from eigenfail_services.store.schema import episodes


def totals(connection: Connection, campaign: int) -> Totals:
    """Sums over all collisions, and episodes counted by class, as `assess` classifies them."""
    # In index order: sums of floats depend on theirs, and reports must not change with it.
    collisions = (
        select(episodes)
        .where(episodes.c.campaign == campaign, episodes.c.outcome == Outcome.COLLISION)
        .order_by(episodes.c["index"])
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
    )
    found = connection.execute(query).one()
    return Totals(
        failures=found.failures,
        log_probability=found.log_probability,
        steps=found.steps,
        severity=found.severity,
        conflicts=ConflictTotals(
            unavoidable=found.unavoidable,
            planner_failures=found.failures - found.unavoidable - found.unclassified,
            unclassified=found.unclassified,
            near_misses=near_misses(connection, campaign),
            ttc_lead_s=found.ttc_lead_s,
            ttc_leads=found.ttc_leads,
            drac_lead_s=found.drac_lead_s,
            drac_leads=found.drac_leads,
        ),
    )


def near_misses(connection: Connection, campaign: int) -> int:
    """How many episodes came near without a collision; an index holds just these."""
    query = select(func.count()).where(
        episodes.c.campaign == campaign,
        episodes.c.outcome == Outcome.SAFE,
        episodes.c.min_ttc_s < NEAR_MISS_TTC_S,
    )
    return connection.execute(query).scalar_one()
