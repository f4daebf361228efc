"""Routes of webhooks: the secret is shown once, and who may do what."""

import pytest

from eigenfail.values.campaign import CampaignState
from eigenfail_webhooks.messages import queue_messages
from eigenfail_webhooks.outbox import Outbox
from eigenfail_webhooks.store import WebhookStore
from eigenfail_webhooks.values import MAX_WEBHOOKS

URL = "https://hooks.example/eigenfail"
WEBHOOKS = "/api/v1/webhooks"


@pytest.fixture
def made(http):
    """The answer to the creation of a webhook."""
    return http.post(WEBHOOKS, json={"url": URL})


def test_the_secret_is_shown_once(http, made):
    assert made.status_code == 201
    assert made.headers["Cache-Control"] == "no-store"
    secret = made.json()["secret"]
    assert secret.startswith("whsec_")
    webhook = made.json()["webhook"]
    assert webhook["events"] == ["analysis.finished", "campaign.ended", "gate.failed"]
    place = made.headers["Location"]
    assert http.get(place).json() == webhook
    http.post(f"{place}/test")
    for path in (WEBHOOKS, place, "/api/v1/audit", "/audit", "/metrics"):
        answer = http.get(path)
        assert answer.status_code == 200, path
        assert secret.removeprefix("whsec_") not in answer.text
        assert "whsec" not in answer.text
    assert secret not in http.delete(place).text


def test_neither_logs_nor_the_audit_log_hold_the_secret(http, made, store, caplog):
    secret = made.json()["secret"]
    entries = store.audit.page(100).items
    assert [entry.subject for entry in entries] == ["/api/v1/webhooks/1"]
    assert secret not in repr(entries) + caplog.text


@pytest.mark.parametrize(
    ("body", "field"),
    [
        ({}, "url"),
        ({"url": ""}, "url"),
        ({"url": "hooks.example"}, "url"),
        ({"url": "ftp://hooks.example/"}, "url"),
        ({"url": "https://ada:secret@hooks.example/"}, "url"),
        ({"url": "https://hooks.example/#part"}, "url"),
        ({"url": "https://hooks.example/\n"}, "url"),
        ({"url": "https://hooks.example:0/"}, "url"),
        ({"url": "https://hooks.example/" + "x" * 2_000}, "url"),
        ({"url": URL, "events": []}, "events"),
        ({"url": URL, "events": ["campaign.began"]}, "events[0]"),
        ({"url": URL, "secret": "whsec_AAAA"}, "secret"),
    ],
)
def test_wrong_webhooks_are_refused_by_the_name_of_the_field(http, problem, store, body, field):
    told = problem(http.post(WEBHOOKS, json=body), 422)
    assert told.get("field", told.get("name")) == field
    assert WebhookStore(store.database).page(10).items == ()


def test_there_is_a_bound(http, problem):
    for _ in range(MAX_WEBHOOKS):
        assert http.post(WEBHOOKS, json={"url": URL}).status_code == 201
    told = problem(http.post(WEBHOOKS, json={"url": URL}), 409)
    assert "eigenfail webhook remove" in told["remedy"]


def test_webhook_shows_its_last_deliveries(http, made, store, campaign):
    place = made.headers["Location"]
    store.campaigns.move(campaign, CampaignState.CANCELLED)
    queue_messages(store, Outbox(store.database))
    queued = http.post(f"{place}/test")
    assert (queued.status_code, queued.headers["Location"]) == (202, place)
    shown = http.get(place).json()
    assert shown["deliveries"][0] == queued.json()
    assert [each["kind"] for each in shown["deliveries"]] == ["webhook.test", "campaign.ended"]
    assert {each["state"] for each in shown["deliveries"]} == {"pending"}
    assert http.get(WEBHOOKS).json()["items"] == [shown]


@pytest.mark.parametrize("wanted", ['"nonsense"', "nonsense", '"a", "b"'])
def test_an_outdated_deletion_is_refused(http, made, problem, wanted):
    place = made.headers["Location"]
    etag = http.get(place).headers["etag"]
    problem(http.delete(place, headers={"If-Match": wanted}), 412)
    problem(http.delete(f"{WEBHOOKS}/99", headers={"If-Match": etag}), 404)
    assert http.delete(place, headers={"If-Match": f'"other", {etag}'}).is_success


def test_an_address_with_a_hidden_character_is_refused(http, problem):
    hidden = "https://hooks.example/\u202e"
    assert problem(http.post(WEBHOOKS, json={"url": hidden}), 422)["field"] == "url"


@pytest.mark.parametrize("number", ["x", "-1", "1.5", "0x1", str(2**63), "9" * 5000, "%00", "<b>"])
def test_what_is_no_id_is_refused(http, problem, number):
    for verb in ("GET", "DELETE"):
        problem(http.request(verb, f"{WEBHOOKS}/{number}"), 422)
