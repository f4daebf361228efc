"""`eigenfail webhook`: what is added, listed, tested and removed."""

import json

import pytest

from eigenfail_services.store.clock import now_ms
from eigenfail_webhooks import commands
from eigenfail_webhooks.dispatcher import judge_status
from eigenfail_webhooks.store import WebhookStore

URL = "https://hooks.example/eigenfail"


def answer(store, status):
    """Conclude the next delivery as if the receiver had answered with a status."""
    outbox = WebhookStore(store.database).outbox
    claimed = outbox.claim(60.0, now_ms())
    outbox.conclude(claimed, judge_status(status, claimed.attempt), now_ms())


@pytest.fixture
def answering(monkeypatch, store):
    """Answer the pending delivery with a status, as soon as the command waits for it."""

    def prepare(status):
        wait = commands.wait_until

        def answered(look, *more):
            answer(store, status)
            return wait(look, *more)

        monkeypatch.setattr(commands, "wait_until", answered)

    return prepare


def test_the_secret_is_printed_once(eigenfail):
    made = eigenfail("webhook", "add", URL, "--event", "gate.failed", "--event", "campaign.ended")
    assert made.exit_code == 0, made.output
    (secret,) = [line for line in made.stdout.splitlines() if line.startswith("whsec_")]
    assert f"Webhook 1 to {URL}, for campaign.ended, gate.failed." in made.stdout
    listed = eigenfail("webhook", "list")
    assert "active" in listed.stdout
    assert secret not in listed.output
    (row,) = json.loads(eigenfail("webhook", "list", "--json").stdout)
    assert row["events"] == ["campaign.ended", "gate.failed"]
    removed = eigenfail("webhook", "remove", 1)
    assert removed.stdout == f"Webhook 1 to {URL} was removed.\n"
    assert json.loads(eigenfail("webhook", "list", "--json").stdout) == []


def test_a_test_event_that_arrives_exits_with_0(eigenfail, answering):
    eigenfail("webhook", "add", URL)
    answering(204)
    tested = eigenfail("webhook", "test", 1)
    assert tested.exit_code == 0, tested.output
    assert "delivered" in tested.stdout


def test_one_that_does_not_exits_with_3_and_is_listed_with_the_error(eigenfail, answering):
    eigenfail("webhook", "add", URL)
    answering(500)
    tested = eigenfail("webhook", "test", 1, "--json")
    assert tested.exit_code == 3
    assert json.loads(tested.stdout)["problem"] == "The receiver answered 500."
    assert "eigenfail webhook list" in tested.stderr
    (row,) = json.loads(eigenfail("webhook", "list", "--json").stdout)
    (waiting,) = row["deliveries"]
    assert (waiting["state"], waiting["attempts"], waiting["status"]) == ("pending", 1, 500)
    listed = " ".join(eigenfail("webhook", "list").stdout.split())
    assert "webhook.test" in listed
    assert "The receiver answered 500." in listed


@pytest.mark.parametrize(
    "words",
    [
        *(["add", "hooks.example"], ["add", URL, "--event", "x"], ["remove", 9], ["test", 9]),
        ["remove", 0],
    ],
)
def test_what_is_wrong_is_said_with_exit_code_2(eigenfail, words):
    refused = eigenfail("webhook", *words)
    assert refused.exit_code == 2
    assert "Traceback" not in refused.output
