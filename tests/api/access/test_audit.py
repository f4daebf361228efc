"""The audit log: every request that changes something, by whom, from where, and how it ended."""

import pytest
from starlette.testclient import TestClient
from store_checks.modes import analysed, crashed

from eigenfail.errors import StoreUnavailable
from eigenfail.testing.examples import analysis_result
from eigenfail_api.access import change_details
from eigenfail_api.app import create_app
from eigenfail_api.settings import ApiSettings

ADDRESS = "http://127.0.0.1:8440"
CAMPAIGNS = "/api/v1/campaigns"


def test_who_did_what_is_written_down(as_holder, keys, fields, changes):
    as_holder("runner", "POST", CAMPAIGNS, json=fields)
    as_holder("runner", "POST", f"{CAMPAIGNS}/1/cancel")
    as_holder("viewer", "POST", f"{CAMPAIGNS}/1/cancel")
    as_holder("runner", "POST", f"{CAMPAIGNS}/77/cancel")
    told = [(each.who, each.method, each.route, each.subject, each.status) for each in changes()]
    cancel = f"{CAMPAIGNS}/{{campaign}}/cancel"
    assert told == [
        ("the runner", "POST", CAMPAIGNS, f"{CAMPAIGNS}/1", 201),
        ("the runner", "POST", cancel, f"{CAMPAIGNS}/1/cancel", 200),
        ("the viewer", "POST", f"{CAMPAIGNS}/1/cancel", f"{CAMPAIGNS}/1/cancel", 403),
        ("the runner", "POST", cancel, f"{CAMPAIGNS}/77/cancel", 404),
    ]
    assert {each.key for each in changes()} == {keys["runner"].key.id, keys["viewer"].key.id}
    assert {each.address for each in changes()} == {"testclient"}


def test_a_fault_of_ours_is_written_down_too(
    *, store, keys, clock, fields, changes, show, monkeypatch
):
    def fail(*_arguments):
        raise RuntimeError("a bug")

    monkeypatch.setattr(store.campaigns, "create", fail)
    app = create_app(store, ApiSettings(), clock)
    with TestClient(app, base_url=ADDRESS, raise_server_exceptions=False) as http:
        answer = http.post(CAMPAIGNS, json=fields, headers=show(keys["runner"].token))
    assert answer.status_code == 500
    assert [(each.who, each.subject, each.status) for each in changes()] == [
        ("the runner", CAMPAIGNS, 500)
    ]


def test_what_is_refused_for_want_of_a_scope_is_written_down(as_holder, changes):
    assert as_holder("viewer", "GET", "/api/v1/keys").status_code == 403
    assert [(each.who, each.method, each.status) for each in changes()] == [
        ("the viewer", "GET", 403)
    ]


def test_reading_is_not_written_down(as_holder, http, fields, changes):
    as_holder("viewer", "GET", CAMPAIGNS)
    as_holder("viewer", "POST", f"{CAMPAIGNS}/check", json=fields)
    http.post(CAMPAIGNS, json=fields)
    assert changes() == ()


def test_without_keys_it_is_whoever_is_on_this_machine(http, fields, changes):
    http.post(CAMPAIGNS, json=fields)
    assert [(each.who, each.key, each.status) for each in changes()] == [("loopback", None, 201)]


def test_the_audit_log_is_read_page_by_page(as_holder, fields):
    for _ in range(3):
        as_holder("runner", "POST", CAMPAIGNS, json=fields)
    first = as_holder("admin", "GET", "/api/v1/audit?limit=2").json()
    rest = as_holder("admin", "GET", f"/api/v1/audit?limit=2&before={first['next']}").json()
    assert [each["id"] for each in first["items"] + rest["items"]] == [3, 2, 1]
    assert rest["next"] is None
    assert as_holder("runner", "GET", "/api/v1/audit").status_code == 403


@pytest.fixture
def triaged(store):
    """The address of a mode of campaign 1."""
    return f"/api/v1/analyses/{analysed(store, crashed(store), analysis_result())}/modes/1"


def test_the_values_that_were_given_are_written_down(as_holder, triaged, changes):
    ticket = "https://tickets.example/7"
    given = {"state": "known", "ticket": ticket, "note": "seen twice"}
    answer = as_holder("runner", "POST", f"{triaged}/triage", json=given)
    assert answer.json()["changed_by"] == "the runner"
    as_holder("runner", "PUT", f"{triaged}/name", json={"name": "late braking"})
    as_holder("runner", "POST", f"{CAMPAIGNS}/1/priority", json={"priority": "high"})
    assert [each.details for each in changes()] == [
        f'state = "known", ticket = "{ticket}"',
        'name = "late braking"',
        'priority = "high"',
    ]


def test_values_of_forms_are_written_down(browser, show, keys, triaged, changes):
    address = triaged.removeprefix("/api/v1")
    form = {"state": "fixed", "ticket": "", "note": "wet", "hidden": "a password"}
    answer = browser.post(f"{address}/triage", data=form, headers=show(keys["runner"].token))
    assert answer.status_code == 303
    assert changes()[-1].details == 'state = "fixed", ticket = ""'


def test_quotas_that_are_taken_away_are_written_down(as_holder, keys, changes):
    key = keys["viewer"].key.id
    as_holder("admin", "POST", f"/api/v1/keys/{key}/quotas", json={"max_open": 3})
    rest = "max_episodes = null, max_episodes_per_day = null"
    new = {"name": "nightly", "scope": "runner", "quotas": {"max_open": 5}}
    as_holder("admin", "POST", "/api/v1/keys", json=new)
    assert [each.details for each in changes()] == [
        f"max_open = 3, {rest}",
        f'name = "nightly", scope = "runner", max_open = 5, {rest}',
    ]


def test_no_secret_is_written_down(as_holder, keys, triaged, changes):
    """Not a key in a value that is recorded, no note, no new secret."""
    token = keys["admin"].token
    made = as_holder("admin", "POST", "/api/v1/keys", json={"name": "nightly"}).json()["token"]
    as_holder("runner", "POST", f"{triaged}/triage", json={"ticket": f"https://t/{token}"})
    as_holder("runner", "PUT", f"{triaged}/name", json={"name": f"x{'y' * 20} {token}"[:80]})
    as_holder("runner", "POST", f"{triaged}/triage", json={"note": f"my words, {token}"})
    text = str([each.details for each in changes()])
    for secret in (token, token[-20:], made, "my words"):
        assert secret not in text


def test_details_are_bounded(as_holder, triaged, changes):
    given = {"state": "known", "ticket": f"https://t/{'t' * 480}"}
    as_holder("runner", "POST", f"{triaged}/triage", json=given)
    details = changes()[-1].details
    assert details.startswith('state = "known", ticket = "https://t/ttt')
    assert len(details) <= change_details.LONGEST_DETAILS
    assert max(map(len, details.split(", "))) <= change_details.LONGEST_VALUE + len("ticket = ")
    assert change_details.format_details((f"f{n}", "x" * 90) for n in range(20)).endswith("…")


def test_a_body_that_is_not_listed_leaves_nothing(as_holder, fields, changes):
    as_holder("runner", "POST", CAMPAIGNS, json={**fields, "settings": {}})
    as_holder("runner", "POST", CAMPAIGNS, json={"nonsense": 1})
    assert {each.details for each in changes()} == {""}


@pytest.mark.parametrize("kind", change_details.RECORDED)
def test_the_fields_that_are_recorded_are_those_of_their_bodies(kind):
    assert {*change_details.RECORDED[kind]} <= {*kind.__struct_fields__}


def test_it_holds_no_body(as_holder, fields, changes):
    as_holder("runner", "POST", CAMPAIGNS, json={**fields, "name": "a body's words"})
    assert "a body's words" not in str(changes())


def test_what_cannot_be_written_down_is_in_the_log(as_holder, fields, store, monkeypatch, caplog):
    def fail(_change):
        raise StoreUnavailable("The disk is full.")

    monkeypatch.setattr(store.audit, "append", fail)
    assert as_holder("runner", "POST", CAMPAIGNS, json=fields).status_code == 201
    (line,) = [each for each in caplog.messages if "not in the audit log" in each]
    assert "the runner" in line
