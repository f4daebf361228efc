"""Migration 0002: results that were stored before the further safety measures."""

import pytest
from sqlalchemy import inspect, text
from store_checks.examples import deliver, running

from eigenfail.testing.examples import collision, result
from eigenfail.values import ConflictClass, Measures
from eigenfail_services.store import migrate, open_store

NEW = {
    *("ttc_violated_s", "drac_violated_s", "drac_at_warning_mps2", "collided_s", "left_road_s"),
    *("max_jerk_mps3", "hard_brakings", "clipped_steps"),
}
INDEX = "ix_episodes_campaign_outcome_min_ttc_s"


def columns(connection) -> set[str]:
    return {column["name"] for column in inspect(connection).get_columns("episodes")}


def indexes(connection) -> set[str]:
    return {index["name"] for index in inspect(connection).get_indexes("episodes")}


def digests(connection) -> list[str]:
    found = connection.execute(text('SELECT digest FROM episodes ORDER BY "index"'))
    return list(found.scalars())


@pytest.fixture
def old(url):
    """A database of release 0001 with a collision, a near miss and a calm episode."""
    store = open_store(url)
    campaign = running(store)
    crash = collision(0, measures=Measures(0.0, 2.5, 1.25, 9.0))
    calm = result(2, measures=Measures(4.0, None, 1.5, 0.5))
    deliver(store, campaign, crash, result(1, measures=Measures(0.5, None, 1.4, 3.0)), calm)
    store.close()
    migrate.downgrade(url, "0001")
    return campaign.id


def test_down_and_up_again(url, look, old) -> None:
    assert not look(url, columns) & NEW
    assert INDEX not in look(url, indexes)
    migrate.upgrade(url)
    assert look(url, columns) >= NEW
    assert INDEX in look(url, indexes)


def test_old_results_are_read_as_what_they_measured(url, look, old) -> None:
    store = open_store(url)
    crash, near, calm = store.episodes.page(old, 10).items
    assert store.episodes.get(old, 0).measures == Measures(0.0, 2.5, 1.25, 9.0)
    assert {getattr(row, name) for row in (crash, near, calm) for name in NEW} == {None}
    # Whether the collision could have been avoided, nobody wrote down.
    assert crash.assessed.conflict is None
    assert near.assessed.conflict is ConflictClass.NEAR_MISS
    assert calm.assessed.conflict is ConflictClass.NONE
    found = store.episodes.totals(old).conflicts
    assert (found.unclassified, found.near_misses) == (1, 1)
    assert (found.unavoidable, found.planner_failures, found.ttc_leads) == (0, 0, 0)
    store.close()


def test_old_results_keep_their_digests(url, look, old) -> None:
    store = open_store(url)
    read = [store.episodes.get(old, index).digest() for index in range(3)]
    store.close()
    assert read == look(url, digests)


def test_a_campaign_goes_on_in_the_new_schema(url, old) -> None:
    store = open_store(url)
    campaign = store.campaigns.get(old)
    deliver(store, campaign, collision(3))
    assert store.episodes.page(old, 1, after=2).items[0].assessed.ttc_lead_s == 2.25
    assert store.episodes.totals(old).conflicts.planner_failures == 1
    store.close()
