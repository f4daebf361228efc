"""Migrations 0024 and 0031: triage comes with its tables, and moves to the modes."""

from sqlalchemy import inspect, text
from store_checks.modes import analysed, crashed

from eigenfail.testing.examples import analysis_result
from eigenfail.values.triage import Triage, TriageChange, TriageState
from eigenfail_services.store import migrate, open_store

BEFORE = """
INSERT INTO triage (kind, parent, number, state, owner, labels, ticket, changed_ms, changed_by)
VALUES ('mode', {0}, 1, 'known', 'anna', 'late', 'https://tickets/7', 9000, 'anna'),
    ('episode', {0}, 2, 'fixed', 'anna', '', 'https://tickets/8', 9000, 'anna');
INSERT INTO triage_notes (kind, parent, number, at_ms, author, text)
VALUES ('mode', {0}, 1, 5000, 'ben', 'an older one'),
    ('mode', {0}, 1, 6000, 'ben', 'as before'),
    ('mode', {0}, 2, 7000, 'ben', 'a note alone'),
    ('episode', {0}, 2, 8000, 'ben', 'of an episode')
"""


def tables(connection) -> set[str]:
    return set(inspect(connection).get_table_names())


def make_analysis(url) -> int:
    store = open_store(url)
    campaign = crashed(store)
    analysis = analysed(store, campaign, analysis_result())
    store.campaigns.move(campaign.id, "done")
    store.campaigns.archive(campaign.id)
    store.close()
    return analysis


def test_earlier_modes_are_new(url, look) -> None:
    analysis = make_analysis(url)
    migrate.downgrade(url, "0023")
    assert not {"triage", "triage_notes"} & look(url, tables)
    store = open_store(url)  # brings the schema up again
    assert store.campaigns.page(1).items[0].archived_ms is None
    assert store.triage.get(analysis, 1) == Triage()
    store.triage.change(analysis, 1, TriageChange(TriageState.KNOWN), "anna")
    assert store.triage.get(analysis, 1).state is TriageState.KNOWN
    store.close()


def test_triage_of_modes_is_kept_with_the_newest_note(url, look) -> None:
    analysis = make_analysis(url)
    migrate.downgrade(url, "0030")

    def fill(connection) -> None:
        for statement in BEFORE.format(analysis).split(";"):
            connection.execute(text(statement))
        connection.commit()

    look(url, fill)
    store = open_store(url)  # brings the schema up again
    known = Triage(TriageState.KNOWN, "https://tickets/7", "as before", 9000, "anna")
    noted = Triage(note="a note alone", changed_ms=7000, changed_by="ben")
    assert store.triage.list_by_number(analysis) == {1: known, 2: noted}
    store.close()
    assert not {"triage", "triage_notes"} & look(url, tables)
    migrate.downgrade(url, "0030")
    store = open_store(url)
    assert store.triage.list_by_number(analysis) == {1: known, 2: noted}
    store.close()
