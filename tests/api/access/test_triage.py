"""Triage and the audit log: who changed what, and who may."""

import pytest
from store_checks.modes import analysed, crashed

from eigenfail.testing.examples import analysis_result


@pytest.fixture
def made(store):
    campaign = crashed(store)
    return campaign.id, analysed(store, campaign, analysis_result())


def test_a_change_is_in_the_audit_log_with_the_name_of_its_key(as_holder, changes, made):
    campaign, analysis = made
    mode = f"/api/v1/analyses/{analysis}/modes/1"
    episodes = f"/api/v1/campaigns/{campaign}/episodes"
    requests = [
        (f"{mode}/triage", {"state": "known"}),
        (f"{mode}/notes", {"text": "as before"}),
        (f"{episodes}/triage", {"filter": "", "change": {"owner": "anna"}}),
    ]
    answers = [as_holder("runner", "POST", path, json=body) for path, body in requests]
    assert [answer.status_code for answer in answers] == [200, 200, 200]
    assert answers[0].json()["changed_by"] == answers[1].json()["author"] == "the runner"
    told = [(each.who, each.subject, each.status) for each in changes()]
    assert told == [("the runner", path, 200) for path, _ in requests]


def test_a_viewer_reads_triage_and_changes_none(as_holder, changes, made):
    _, analysis = made
    mode = f"/api/v1/analyses/{analysis}/modes/1"
    assert as_holder("viewer", "GET", f"{mode}/triage").status_code == 200
    assert as_holder("viewer", "GET", f"{mode}/notes").status_code == 200
    assert as_holder("viewer", "POST", f"{mode}/triage", json={"state": "known"}).status_code == 403
    assert as_holder("viewer", "POST", f"{mode}/notes", json={"text": "x"}).status_code == 403
    assert as_holder("viewer", "GET", f"{mode}/triage").json()["state"] == "new"
    assert {each.status for each in changes()} == {403}
