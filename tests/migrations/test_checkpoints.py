"""Migration 0011: the checkpoint before the last one, hashes, and leases by another clock."""

from sqlalchemy import inspect, text
from store_checks.examples import running
from store_checks.jobs import LONG_S, claimed

from eigenfail_services.store import migrate, open_store


def shape(connection) -> tuple[set[str], list[str], set[str]]:
    """Columns and key of the checkpoints, columns of the jobs."""
    found = inspect(connection)
    columns = {column["name"] for column in found.get_columns("checkpoints")}
    key = found.get_pk_constraint("checkpoints")["constrained_columns"]
    return columns, key, {column["name"] for column in found.get_columns("jobs")}


def rows(connection) -> list[tuple[int, bytes]]:
    query = "SELECT campaign, state FROM checkpoints ORDER BY campaign"
    return [(campaign, bytes(state)) for campaign, state in connection.execute(text(query))]


def test_down_and_up_again(url, look) -> None:
    open_store(url).close()
    migrate.downgrade(url, "0010")
    columns, key, jobs = look(url, shape)
    assert not columns & {"number", "sha256"}
    assert (key, "lease_ms" in jobs) == (["campaign"], False)
    migrate.upgrade(url)
    columns, key, jobs = look(url, shape)
    assert columns >= {"number", "sha256"}
    assert (key, "lease_ms" in jobs) == (["campaign", "number"], True)


def test_of_two_checkpoints_the_last_one_stays(url, look) -> None:
    store = open_store(url)
    one, two = running(store).id, running(store).id
    for campaign, state in ((one, b"1"), (two, b"a"), (one, b"2"), (one, b"3")):
        store.checkpoints.save(campaign, state)
    store.close()
    migrate.downgrade(url, "0010")
    assert look(url, rows) == [(one, b"3"), (two, b"a")]


def test_the_one_checkpoint_of_an_older_release_is_gone_on_from(url) -> None:
    store = open_store(url)
    campaign = running(store).id
    store.checkpoints.save(campaign, b"state")
    store.close()
    migrate.downgrade(url, "0010")
    store = open_store(url)
    assert store.checkpoints.load(campaign) == store.checkpoints.recover(campaign) == b"state"
    for state in (b"later", b"latest"):
        store.checkpoints.save(campaign, state)
        assert store.checkpoints.load(campaign) == state
    store.close()


def test_what_was_leased_by_another_clock_is_free(url) -> None:
    store = open_store(url)
    campaign = running(store).id
    claimed(store, LONG_S)
    store.close()
    migrate.downgrade(url, "0010")
    store = open_store(url)
    assert claimed(store, LONG_S).subject == campaign
    store.close()
