"""The page of webhooks: what is told to whom, and what became of it; no secret is on it."""

import re

import pytest

from eigenfail.values.access import KeyRequest, Scope
from eigenfail.values.webhooks import WebhookEvent, WebhookRequest
from eigenfail_services.access import make_key
from eigenfail_services.store.clock import now_ms
from eigenfail_services.webhooks.dispatcher import judge_failure, judge_status

HTML = {"Accept": "text/html"}
SECRET = "whsec_bm90IGEgc2VjcmV0IG9mIGFueWJvZHk="


@pytest.fixture
def webhooks(store):
    """Two webhooks, one of them inactive, with deliveries in every state."""
    request = WebhookRequest("https://hooks.example/<b>", (WebhookEvent.GATE_FAILED,))
    made = [store.webhooks.create(each, SECRET) for each in (request, WebhookRequest("http://h/"))]
    outbox = store.webhooks.outbox
    for outcome in (
        judge_status(204, 1),
        judge_failure("10.0.0.7 is not a public address.", 1),
        judge_status(410, 1),
    ):
        store.webhooks.test(made[0].id)
        outbox.conclude(outbox.claim(60.0, now_ms()), outcome, now_ms())
    store.webhooks.set_active(made[0].id, active=True)
    store.webhooks.set_active(made[1].id, active=False)
    return made


def test_without_webhooks_the_page_says_so(check_page) -> None:
    check_page("dashboard/webhooks/none", "/webhooks")


def test_webhooks_and_their_deliveries_are_listed(http, webhooks) -> None:
    text = http.get("/webhooks", headers=HTML).text
    assert "whsec" not in text
    assert "https://hooks.example/&lt;b&gt;" in text
    words = re.sub(r"\s+", " ", re.sub(r"<[^>]+>", " ", text))
    for told in ("204 No Content", "410 Gone", "10.0.0.7 is not a public address.", "inactive"):
        assert told in words
    assert re.findall(r'action="/api/v1/webhooks/(\d)/(\w+)"', text) == [
        *(("2", "test"), ("2", "activate"), ("1", "test"), ("1", "deactivate")),
    ]
    assert len(re.findall(r"/deliveries/\d+/redeliver", text)) == 3
    cells = re.findall(r'data-label="(?:Pending|Delivered|Failed)" class="num">(\d+)<', text)
    assert cells == ["0", "0", "0", "1", "1", "1"]


def test_it_is_for_administrators(http, store, webhooks) -> None:
    tokens = {
        scope: make_key(store, KeyRequest(scope.value, scope)).token
        for scope in (Scope.ADMIN, Scope.RUNNER)
    }
    http.app.state.authenticator.note_new_key()
    statuses = {
        scope: http.get("/webhooks", headers=HTML | {"Authorization": f"Bearer {token}"})
        for scope, token in tokens.items()
    }
    assert statuses[Scope.ADMIN].status_code == 200
    assert statuses[Scope.RUNNER].status_code == 403
    assert "hooks.example" not in statuses[Scope.RUNNER].text
