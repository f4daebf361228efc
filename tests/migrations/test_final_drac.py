"""Migration 0016: DRAC at the last step, of which older results know nothing."""

import pytest
from sqlalchemy import inspect, text
from store_checks.examples import deliver, running

from eigenfail.testing.examples import collision, result
from eigenfail.values import Measures
from eigenfail_services.store import migrate, open_store

CALM = Measures(4.0, None, 1.5, 7.0, final_drac_mps2=7.0)
ENDED = Measures(1.3, None, 0.2, 30.0, final_drac_mps2=22.0)


def columns(connection) -> set[str]:
    return {column["name"] for column in inspect(connection).get_columns("episodes")}


def digests(connection) -> list[str]:
    return list(connection.execute(text('SELECT digest FROM episodes ORDER BY "index"')).scalars())


@pytest.fixture
def old(url):
    """A database of release 0015 with a collision and two episodes that ended without."""
    store = open_store(url)
    campaign = running(store)
    deliver(store, campaign, collision(0), result(1, measures=CALM), result(2, measures=ENDED))
    store.close()
    migrate.downgrade(url, "0015")
    return campaign.id


def test_down_and_up_again(url, look, old) -> None:
    assert "final_drac_mps2" not in look(url, columns)
    migrate.upgrade(url)
    assert "final_drac_mps2" in look(url, columns)


def test_how_older_episodes_ended_is_known_only_where_their_largest_drac_tells(
    url, look, old
) -> None:
    store = open_store(url)
    rows = store.episodes.page(old, 10).items
    assert [row.assessed.unresolved for row in rows] == [False, False, None]
    found = store.episodes.totals(old).conflicts
    assert (found.unresolved, found.perhaps_unresolved) == (0, 1)
    read = [store.episodes.get(old, index).digest() for index in range(3)]
    store.close()
    assert read == look(url, digests)


def test_a_campaign_goes_on_in_the_new_schema(url, old) -> None:
    store = open_store(url)
    deliver(store, store.campaigns.get(old), result(3, measures=ENDED))
    found = store.episodes.totals(old).conflicts
    store.close()
    assert (found.unresolved, found.perhaps_unresolved) == (1, 1)
