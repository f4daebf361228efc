"""docs/webhooks.md and the receiver of examples/, beside what the code does."""

import json
import re
import socket
import ssl
import subprocess
import sys

import anyio
import deadlines
import httpx2
import pytest
from typer.main import get_command

from eigenfail_services.store.clock import now_ms
from eigenfail_services.store.store import open_store
from eigenfail_webhooks.addresses import parse_networks
from eigenfail_webhooks.commands import app
from eigenfail_webhooks.dispatcher import (
    ATTEMPT_S,
    LEASE_S,
    MAX_ATTEMPTS,
    WebhookDispatcher,
    find_retry_s,
    send_delivery,
)
from eigenfail_webhooks.outbox import KEPT_DELIVERIES
from eigenfail_webhooks.signatures import make_secret, sign_message
from eigenfail_webhooks.store import WebhookStore
from eigenfail_webhooks.values import EVERY_EVENT, MAX_WEBHOOKS, WebhookRequest


@pytest.fixture(scope="module")
def text(plugin):
    return (plugin / "docs" / "webhooks.md").read_text()


def test_every_event_is_described(text):
    table = text.partition("## Events\n")[2].partition("\n## ")[0]
    assert re.findall(r"^\| `([\w.]+)` \|", table, re.MULTILINE) == [*EVERY_EVENT]


def test_the_figures_are_those_of_the_code(text):
    delays = [find_retry_s(number) for number in range(1, MAX_ATTEMPTS)]
    told = [float(number) for number in re.findall(r"`(\d+) s`", text)]
    assert told == [*dict.fromkeys(delays)]
    assert delays.count(told[-1]) == 2
    words = " ".join(text.split())
    assert f"up to {MAX_ATTEMPTS} times in all" in words
    assert f"together {sum(delays) / 3_600:.1f} hours" in words
    assert f"within {ATTEMPT_S:g} s ends the delivery" in words
    assert f"has run out, after {LEASE_S:g} s." in words
    assert f"at most {MAX_WEBHOOKS} webhooks" in words
    assert f"the newest {KEPT_DELIVERIES:,} deliveries" in words


def test_every_command_of_the_page_exists(text):
    commands = get_command(app).commands
    told = set(re.findall(r"^eigenfail webhook (\w+)", text, re.MULTILINE))
    assert told == set(commands)


@pytest.fixture
def receiver(plugin):
    """The secret, the address and the process of the receiver of examples/."""
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
    secret = make_secret()
    process = subprocess.Popen(
        [sys.executable, plugin / "examples" / "webhook_receiver.py", str(port)],
        env={"WEBHOOK_SECRET": secret, "PATH": ""},
        stdout=subprocess.PIPE,
        text=True,
    )
    transport = httpx2.HTTPTransport(retries=8)  # until it listens
    with httpx2.Client(transport=transport, trust_env=False, timeout=deadlines.PROCESS_S) as http:
        yield secret, f"http://127.0.0.1:{port}/", http, process
    process.kill()
    process.communicate()


def test_the_receiver_takes_what_is_genuine_once(receiver):
    secret, address, http, process = receiver
    assert http.post(address, content=b"{}").status_code == 400
    store = open_store("memory://")
    webhook = WebhookStore(store.database).create(WebhookRequest(address), secret)
    networks = parse_networks("127.0.0.0/8")
    dispatcher = WebhookDispatcher(store, networks)
    WebhookStore(store.database).test(webhook.id)
    # The services were killed before they wrote that the message had arrived.
    lost = WebhookStore(store.database).outbox.claim(0.0, now_ms())
    anyio.run(send_delivery, lost, networks, ssl.create_default_context())
    WebhookStore(store.database).test(webhook.id)
    dispatcher.turn()
    states = [each.state for each in WebhookStore(store.database).get(webhook.id).deliveries]
    store.close()
    assert states == ["delivered"] * 2
    at_s = now_ms() // 1_000
    headers = {"webhook-id": "evt_last", "webhook-timestamp": str(at_s)}
    body = json.dumps({"type": "last", "data": {}}).encode()
    forged = headers | {"webhook-signature": sign_message(make_secret(), "evt_last", at_s, body)}
    assert http.post(address, content=body, headers=forged).status_code == 400
    genuine = headers | {"webhook-signature": sign_message(secret, "evt_last", at_s, body)}
    assert http.post(address, content=body, headers=genuine).status_code == 204
    lines = [process.stdout.readline().split()[0] for _ in range(3)]
    assert lines == ["webhook.test", "webhook.test", "last"]
