"""Campaigns of one method among peers, summed up by the database."""

from typing import Any

import msgspec
from sqlalchemy import Connection, Double, cast, func, select

from eigenfail.values.pool import Peers, Pool
from eigenfail_services.store.schema import campaigns
from eigenfail_services.store.spec_fields import spec_field

SECONDS_PER_HOUR = 3_600.0
PEERS = Peers.__struct_fields__
STRUCTURED = ("planner_settings", "scenario_parameters", "disturbance")


def pools(connection: Connection) -> tuple[Pool, ...]:
    """All campaigns by peers and method; the newest first."""
    hours = campaigns.c.active_s * cast(spec_field("instances"), Double) / SECONDS_PER_HOUR
    usd = hours * cast(spec_field("price_usd_per_hour"), Double)
    facts = (
        select(
            *(spec_field(name).label(name) for name in (*PEERS, "method")),
            *(campaigns.c.id, campaigns.c.completed, campaigns.c.failures),
            *(hours.label("hours"), usd.label("usd")),
        )
        .order_by(campaigns.c.id)
        .subquery()
        .c
    )
    same = [facts[name] for name in (*PEERS, "method")]
    newest = func.max(facts.id).label("newest")
    query = (
        select(
            *same,
            newest,
            func.count().label("campaigns"),
            func.sum(facts.completed).label("completed"),
            func.sum(facts.failures).label("failures"),
            func.sum(facts.hours).label("instance_hours"),
            func.sum(facts.usd).label("total_usd"),
        )
        .group_by(*same)
        .order_by(newest.desc())
    )
    return tuple(pool(dict(found)) for found in connection.execute(query).mappings())


def pool(found: dict[str, Any]) -> Pool:
    """From a row; what is structured stands in it as JSON."""
    given = {name: found.pop(name) for name in PEERS}
    parts = {name: msgspec.json.decode(given[name]) for name in STRUCTURED}
    return Pool(peers=msgspec.convert(given | parts, Peers), **found)
