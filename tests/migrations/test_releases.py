"""Migration 0023: version of the planner, project and tags of a campaign."""

import json

import msgspec
from sqlalchemy import inspect, text
from store_checks.examples import running

from eigenfail_services.store import migrate, open_store

NAMES = {"planner_version", "project", "tags"}
NAMED = {"planner_version": "v1.2", "project": "highway", "tags": ("nightly", "größer")}


def columns(connection) -> set[str]:
    return {column["name"] for column in inspect(connection).get_columns("campaigns")}


def indexes(connection) -> set[str]:
    return {index["name"] for index in inspect(connection).get_indexes("campaigns")}


def specs(connection) -> list[str]:
    return list(connection.execute(text("SELECT spec FROM campaigns ORDER BY id")).scalars())


def named(connection) -> list[tuple[str | None, ...]]:
    names = "planner_version, project, tags"
    return [*map(tuple, connection.execute(text(f"SELECT {names} FROM campaigns ORDER BY id")))]


def test_down_and_up_again(url, look) -> None:
    store = open_store(url)
    plain = running(store)
    full = running(store, name='a "planner_version": of it', price_usd_per_hour=1e-05, **NAMED)
    store.close()
    before = look(url, specs)
    migrate.downgrade(url, "0022")
    assert not NAMES & look(url, columns)
    assert not {"ix_campaigns_project_id"} & look(url, indexes)
    # An earlier program refuses fields that it does not know; the others are untouched.
    assert look(url, specs) == [before[0], before[1].replace(',"planner_version":"v1.2"', "")]
    assert not any(NAMES & json.loads(spec).keys() for spec in look(url, specs))
    migrate.upgrade(url)
    assert look(url, columns) >= NAMES
    assert look(url, indexes) >= {"ix_campaigns_project_id", "ix_campaigns_planner_version_id"}
    lost = dict.fromkeys(NAMES, msgspec.UNSET)
    store = open_store(url)
    assert store.campaigns.get(plain.id) == plain
    spec = msgspec.structs.replace(full.spec, **lost)
    assert store.campaigns.get(full.id) == msgspec.structs.replace(full, spec=spec)
    store.close()


def test_columns_are_filled_with_what_the_specs_say(url, look) -> None:
    store = open_store(url)
    running(store)
    full = running(store, **NAMED)
    store.close()
    wanted = look(url, named)
    migrate.downgrade(url, "0022")

    def restore(connection) -> None:
        fields = json.loads(specs(connection)[1]) | NAMED
        change = text("UPDATE campaigns SET spec = :spec WHERE id = :id")
        spec = msgspec.json.encode(fields).decode()
        connection.execute(change, {"spec": spec, "id": full.id})
        connection.commit()

    look(url, restore)
    migrate.upgrade(url)
    assert wanted[1] == ("v1.2", "highway", '["nightly","größer"]')
    assert look(url, named) == wanted
    store = open_store(url)
    assert store.campaigns.get(full.id) == full
    store.close()
