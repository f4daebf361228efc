"""The pages of keys and of the audit log."""

import re

import pytest

from eigenfail.values.access import KeyRequest, Quotas, Scope
from eigenfail_services.access import make_key
from eigenfail_services.store.clock import now_ms

HTML = {"Accept": "text/html"}


@pytest.fixture
def key_of(store, http):
    """Makes a key, which is needed from then on; the header that shows it."""

    def make(name, scope=Scope.ADMIN, expires_s=None):
        made = make_key(store, KeyRequest(name, scope, expires_s))
        http.app.state.authenticator.note_new_key()
        return HTML | {"Authorization": f"Bearer {made.token}"}

    return make


def test_before_the_first_key_the_page_says_what_it_changes(check_page) -> None:
    check_page("dashboard/keys/none", "/keys")


def test_keys_are_listed_with_their_states_and_no_secret(http, golden, store, key_of) -> None:
    admin = key_of("ada")
    key_of("old <b>", Scope.VIEWER, 1)
    key_of("gone", Scope.RUNNER)
    store.keys.revoke(3)
    http.app.state.authenticator.clock = lambda: now_ms() + 2_000
    text = http.get("/keys", headers=admin).text
    *_, secret = admin["Authorization"].split("_", 2)
    assert secret not in text
    golden.check_page("dashboard/keys/three", text)


def test_the_quotas_of_a_key_can_be_changed_while_it_opens_anything(http, store, key_of) -> None:
    admin = key_of("ada")
    key_of("gone", Scope.RUNNER)
    store.keys.limit(1, Quotas(max_open=3))
    store.keys.revoke(2)
    text = http.get("/keys", headers=admin).text
    assert re.findall(r'action="/api/v1/keys/(\d+)/quotas"', text) == ["1"]
    values = dict(re.findall(r'<input name="(max_\w+)"[^>]* value="(\d*)"', text))
    assert values == {"max_open": "3", "max_episodes": "", "max_episodes_per_day": ""}


def test_older_keys_are_on_further_pages(http, key_of, monkeypatch) -> None:
    monkeypatch.setattr("eigenfail_api.dashboard.keys_page.KEYS_ON_A_PAGE", 1)
    key_of("first")
    admin = key_of("second")
    assert "Older keys" in http.get("/keys", headers=admin).text
    older = http.get("/keys?before=2", headers=admin).text
    assert "first" in older
    assert "Newest keys" in older
    assert "No older keys" in http.get("/keys?before=1", headers=admin).text


def test_a_log_without_lines_says_so(check_page) -> None:
    check_page("dashboard/audit/empty", "/audit")


def test_the_log_tells_who_did_what_and_what_was_refused(http, golden, key_of, campaign) -> None:
    admin, viewer = key_of("ada"), key_of("eve", Scope.VIEWER)
    for holder in (admin, viewer):
        http.post(f"/api/v1/campaigns/{campaign}/pause", headers=holder | {"Accept": "*/*"})
    golden.check_page("dashboard/audit/refused", http.get("/audit", headers=admin).text)
