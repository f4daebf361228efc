"""Triage and the audit log: who changed what, and who may."""

import pytest
from store_checks.modes import analysed, crashed

from eigenfail.testing.examples import analysis_result


@pytest.fixture
def mode(store):
    analysis = analysed(store, crashed(store), analysis_result())
    return f"/api/v1/analyses/{analysis}/modes/1"


def test_a_change_is_in_the_audit_log_with_the_name_of_its_key(as_holder, changes, mode):
    given = {"state": "known", "note": "as before"}
    answer = as_holder("runner", "POST", f"{mode}/triage", json=given)
    assert answer.status_code == 200
    assert answer.json()["changed_by"] == "the runner"
    told = [(each.who, each.subject, each.status) for each in changes()]
    assert told == [("the runner", f"{mode}/triage", 200)]


def test_a_viewer_reads_triage_and_changes_none(as_holder, changes, mode):
    assert as_holder("viewer", "GET", f"{mode}/triage").status_code == 200
    assert as_holder("viewer", "POST", f"{mode}/triage", json={"state": "known"}).status_code == 403
    assert as_holder("viewer", "GET", f"{mode}/triage").json()["state"] == "new"
    assert {each.status for each in changes()} == {403}
