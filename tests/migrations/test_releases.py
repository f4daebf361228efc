"""Migration 0023: version of the planner, project and tags of a campaign."""

from sqlalchemy import inspect
from store_checks.examples import running

from eigenfail_services.store import migrate, open_store

NAMES = {"planner_version", "project", "tags"}


def columns(connection) -> set[str]:
    return {column["name"] for column in inspect(connection).get_columns("campaigns")}


def indexes(connection) -> set[str]:
    return {index["name"] for index in inspect(connection).get_indexes("campaigns")}


def test_down_and_up_again(url, look) -> None:
    store = open_store(url)
    campaign = running(store)
    store.close()
    migrate.downgrade(url, "0022")
    assert not NAMES & look(url, columns)
    assert not {"ix_campaigns_project_id"} & look(url, indexes)
    migrate.upgrade(url)
    assert look(url, columns) >= NAMES
    assert look(url, indexes) >= {"ix_campaigns_project_id", "ix_campaigns_planner_version_id"}
    store = open_store(url)
    assert store.campaigns.get(campaign.id) == campaign
    store.close()
