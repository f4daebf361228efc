"""Migration 0024: earlier modes and episodes are new, and no earlier campaign is archived."""

from sqlalchemy import inspect
from store_checks.modes import analysed, crashed

from eigenfail.testing.examples import analysis_result
from eigenfail.values.triage import UNTOUCHED, TriageChange, TriageState
from eigenfail_services.store import migrate, open_store
from eigenfail_services.store.triage import episode_subject, mode_subject


def tables(connection) -> set[str]:
    return set(inspect(connection).get_table_names())


def test_earlier_modes_and_episodes_are_new(url, look) -> None:
    store = open_store(url)
    campaign = crashed(store)
    analysis = analysed(store, campaign, analysis_result())
    digest = store.episodes.digest(campaign.id)
    store.campaigns.move(campaign.id, "done")
    store.campaigns.archive(campaign.id)
    store.close()
    migrate.downgrade(url, "0023")
    assert not {"triage", "triage_notes"} & look(url, tables)
    store = open_store(url)  # brings the schema up again
    assert store.campaigns.get(campaign.id).archived_ms is None
    for subject in (mode_subject(analysis, 1), episode_subject(campaign.id, 0)):
        assert store.triage.get(subject) == UNTOUCHED
        store.triage.change(subject, TriageChange(TriageState.KNOWN), "anna")
        store.triage.add_note(subject, "as before", "anna")
        assert [note.text for note in store.triage.notes(subject, 9).items] == ["as before"]
    assert store.episodes.page(campaign.id, 1).items[0].state is TriageState.KNOWN
    assert store.episodes.digest(campaign.id) == digest
    store.close()
