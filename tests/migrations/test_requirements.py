"""Migration 0019: what requirements say of episodes, which older releases knew nothing of."""

import pytest
from sqlalchemy import inspect
from store_checks.examples import deliver, running
from store_checks.requirements import NAMED, judged

from eigenfail.errors import Conflict
from eigenfail.testing.examples import collision
from eigenfail_services.store import migrate, open_store


def tables(connection) -> set[str]:
    return set(inspect(connection).get_table_names())


def test_down_and_up_again(url, look) -> None:
    store = open_store(url)
    campaign = running(store)
    deliver(store, campaign, collision(0))
    store.close()
    migrate.downgrade(url, "0018")
    assert "requirement_values" not in look(url, tables)
    store = open_store(url)  # brings the schema up again
    found = store.episodes.get(campaign.id, 0)
    store.close()
    assert found.requirements == ()
    assert found.digest() == collision(0).digest()


def test_an_older_program_is_kept_from_what_it_would_misread(url, look) -> None:
    store = open_store(url)
    deliver(store, running(store, requirements=NAMED), judged(0, 4.0, -0.25))
    store.close()
    with pytest.raises(Conflict, match="requirements"):
        migrate.downgrade(url, "0018")
    assert "requirement_values" in look(url, tables)
