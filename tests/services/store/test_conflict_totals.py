"""Counting conflicts reads an index, not every episode."""

from contextlib import closing

import pytest
from sqlalchemy import event
from store_checks.examples import deliver, running

from eigenfail.testing.examples import collision, result
from eigenfail.values.measures import Measures
from eigenfail_services.store.engine import Database, find_backend
from eigenfail_services.store.store import open_store
from eigenfail_services.store.totals import sum_campaigns

INDEXES = (
    "COVERING INDEX ix_episodes_campaign_outcome_min_ttc_s",
    "INDEX ix_episodes_unresolved",
)


@pytest.mark.parametrize("index", INDEXES)
def test_what_was_near_is_counted_in_an_index(sqlite_url, index) -> None:
    with closing(Database(find_backend(sqlite_url))) as database, database.reading() as connection:
        asked = []
        event.listen(connection, "before_cursor_execute", lambda *told: asked.append(told[2:4]))
        sum_campaigns(connection, [1])
        plans = [
            connection.exec_driver_sql(f"EXPLAIN QUERY PLAN {statement}", given).all()
            for statement, given in list(asked)
        ]
    assert any(index in str(plan) for plan in plans)


def test_sums_do_not_depend_on_the_order_of_arrival(url) -> None:
    store = open_store(url)
    leads = [0.1, 1e6, 0.2, 1e-7, 0.3]
    crashes = [
        collision(index, measures=Measures(0.0, 1.0, ttc_violated_s=0.0, collided_s=lead))
        for index, lead in enumerate(leads)
    ]
    forwards, backwards = running(store), running(store)
    deliver(store, forwards, *crashes, result(9))
    for crash in reversed(crashes):
        deliver(store, backwards, crash)
    store.close()
    with closing(Database(find_backend(url))) as database, database.reading() as connection:
        both = sum_campaigns(connection, [forwards.id, backwards.id])
        found = [both[each.id].conflicts for each in (forwards, backwards)]
    assert found[0].ttc_lead_s == found[1].ttc_lead_s == sum(leads)
    assert found[0].ttc_leads == 5
