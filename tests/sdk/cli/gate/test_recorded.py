"""A gate reports its verdict to the service, whose webhooks are told of one that is closed."""

import json

from eigenfail.client.versions import Gates
from eigenfail.errors import Forbidden
from eigenfail.values.webhooks import WebhookEvent, WebhookRequest
from eigenfail_services.store.clock import now_ms


def test_a_result_is_listed_shown_and_stored_once(gate, eigenfail, store):
    first = gate("usual", "--json")
    assert gate("usual", "--json").stdout == first.stdout
    newest, *_ = store.gates.page(10).items
    (listed, made) = json.loads(eigenfail("gate", "list", "--json").stdout)
    assert (listed["id"], listed["version"], listed["baseline"]) == (newest.id, "v2", "v1")
    assert (made["baseline"], made["version"]) == ("", "v1")
    shown = json.loads(eigenfail("gate", "show", newest.id, "--json").stdout)
    assert shown["report"] == json.loads(first.stdout)
    assert shown["conclusions"][0] in eigenfail("gate", "show", newest.id).stdout.replace("\n", " ")
    assert "trio" in eigenfail("gate", "list").stdout
    assert eigenfail("gate", "show", 99).exit_code == 2


def test_a_closed_gate_is_told_and_an_open_one_is_logged(gate, store):
    request = WebhookRequest("https://hooks.example/", (WebhookEvent.GATE_FAILED,))
    webhook = store.webhooks.create(request, "whsec_AAAA")
    assert gate("usual").exit_code == 0
    kind, message = store.events.latest(1)[0].kind, store.events.latest(1)[0].message
    assert kind == "gate.passed"
    assert message == "Version v2 passed the gate of suite 'trio' against v1."
    assert store.webhooks.get(webhook.id).deliveries == ()
    assert gate("usual", "--strict").exit_code == 1
    payload = json.loads(store.webhooks.outbox.claim(60.0, now_ms()).payload)
    assert payload["type"] == "gate.failed"
    assert payload["data"]["gate"] == store.gates.page(1).items[0].id
    named = {name: payload["data"][name] for name in ("suite", "version", "run", "baseline")}
    assert named == {"suite": "trio", "version": "v2", "run": "trio @ v2", "baseline": "v1"}
    assert "is closed" in payload["data"]["conclusions"][0]


def test_the_verdict_stands_where_the_service_does_not_take_it(gate, monkeypatch):
    def refuse(*_):
        raise Forbidden("This needs a key with scope 'runner'.", "Request such a key.")

    monkeypatch.setattr(Gates, "record", refuse)
    done = gate("usual", "--strict", "--json")
    assert done.exit_code == 1
    assert not json.loads(done.stdout)["open"]
    assert "did not record the verdict: This needs a key" in done.stderr
