"""Suites in SQL: campaigns taken together by what stands before the first ": " of their names."""

from collections.abc import Sequence
from typing import Any

from sqlalchemy import Connection, Row, func, select

from eigenfail.values import CampaignState, Page
from eigenfail.values.suite import SuiteStanding
from eigenfail_services.store.schema import campaigns

States = dict[str, dict[CampaignState, int]]


def suites_page(connection: Connection, limit: int, before: int | None) -> Page[SuiteStanding]:
    """Suites by their newest campaigns, newest first, of those with ids below `before`."""
    newest = func.max(campaigns.c.id)
    query = (
        select(
            campaigns.c.suite,
            newest.label("newest"),
            func.count().label("campaigns"),
            *(func.sum(campaigns.c[name]).label(name) for name in SUMS),
        )
        .where(campaigns.c.suite.is_not(None))
        .group_by(campaigns.c.suite)
        .order_by(newest.desc())
        .limit(limit + 1)
    )
    if before is not None:
        query = query.having(newest < before)
    found = connection.execute(query).all()
    states = states_of(connection, [row.suite for row in found])
    items = tuple(standing(row, states) for row in found[:limit])
    return Page(items, items[-1].newest if len(found) > limit else None)


SUMS = ("planned", "completed", "failures")


def states_of(connection: Connection, names: Sequence[str]) -> States:
    """How many campaigns of each of some suites are in which state."""
    query = (
        select(campaigns.c.suite, campaigns.c.state, func.count().label("n"))
        .where(campaigns.c.suite.in_(names))
        .group_by(campaigns.c.suite, campaigns.c.state)
        .order_by(campaigns.c.state)
    )
    found: States = {name: {} for name in names}
    for row in connection.execute(query):
        found[row.suite][CampaignState(row.state)] = row.n
    return found


def standing(row: Row[Any], states: States) -> SuiteStanding:
    """A suite from its row."""
    return SuiteStanding(
        name=row.suite,
        newest=row.newest,
        campaigns=row.campaigns,
        states=states[row.suite],
        **{name: int(getattr(row, name)) for name in SUMS},
    )
