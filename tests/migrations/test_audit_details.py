"""Migration 0028: details of the changes in the audit log; lines of earlier releases have none."""

from sqlalchemy import inspect

from eigenfail.values.access import Change
from eigenfail_services.store import migrate, open_store

CHANGE = Change("anna", None, "PUT", "/api/v1/{x}", "/api/v1/1", "127.0.0.1", 200, 'owner = "b"')


def columns(connection) -> set[str]:
    return {column["name"] for column in inspect(connection).get_columns("audit")}


def test_details_come_and_go_and_lines_stay(url, look) -> None:
    store = open_store(url)
    written = store.audit.append(CHANGE)
    assert store.audit.page(10).items == (written,)
    assert written.details == CHANGE.details
    store.close()
    migrate.downgrade(url, "0025")
    assert "details" not in look(url, columns)
    store = open_store(url)  # brings the schema up again
    (kept,) = store.audit.page(10).items
    assert (kept.id, kept.subject, kept.details) == (written.id, CHANGE.subject, "")
    store.close()
