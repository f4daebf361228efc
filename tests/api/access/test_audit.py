"""The audit log: every request that changes something, by whom, from where, and how it ended."""

from starlette.testclient import TestClient

from eigenfail.errors import StoreUnavailable
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


def test_it_is_read_page_by_page(as_holder, fields):
    for _ in range(3):
        as_holder("runner", "POST", CAMPAIGNS, json=fields)
    first = as_holder("admin", "GET", "/api/v1/audit?limit=2").json()
    rest = as_holder("admin", "GET", f"/api/v1/audit?limit=2&before={first['next']}").json()
    assert [each["id"] for each in first["items"] + rest["items"]] == [3, 2, 1]
    assert rest["next"] is None
    assert as_holder("runner", "GET", "/api/v1/audit").status_code == 403


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
