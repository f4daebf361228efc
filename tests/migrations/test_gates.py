"""Migration 0026: results of gates; what was there before stays."""

from sqlalchemy import inspect
from store_checks.examples import running
from store_checks.gates import make_report

from eigenfail.gate.verdicts import GateVerdict
from eigenfail_services.store import migrate, open_store


def tables(connection) -> set[str]:
    return set(inspect(connection).get_table_names())


def test_results_come_and_go_and_campaigns_stay(url, look) -> None:
    store = open_store(url)
    campaign = running(store)
    store.gates.record(make_report(GateVerdict.NEW))
    store.close()
    migrate.downgrade(url, "0025")
    assert "gates" not in look(url, tables)
    store = open_store(url)  # brings the schema up again
    assert "gates" in look(url, tables)
    assert store.gates.page(10).items == ()
    assert store.campaigns.get(campaign.id).id == campaign.id
    store.close()
