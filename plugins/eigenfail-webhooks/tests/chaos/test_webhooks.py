"""Events for webhooks, with services that are killed before, during and after their delivery."""

import json
import sqlite3
from collections import Counter
from collections.abc import Iterator
from contextlib import closing
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from threading import Thread

import deadlines
import pytest
from sqlalchemy import text
from stage import Stage
from started import Services, wait_until

from eigenfail.values.campaign import CampaignState
from eigenfail_services.store.store import open_store
from eigenfail_webhooks.addresses import VARIABLE
from eigenfail_webhooks.signatures import make_secret, verify_message
from eigenfail_webhooks.store import WebhookStore
from eigenfail_webhooks.values import WebhookEvent, WebhookRequest

pytestmark = [pytest.mark.service, pytest.mark.timeout(deadlines.TEST_S)]

OPEN = text("SELECT count(*) FROM plugin_webhooks_deliveries WHERE state = 'pending'")
QUEUED = text("SELECT count(*) FROM plugin_webhooks_deliveries")
ENDED = text("SELECT count(*) FROM campaigns WHERE state = 'done'")


class Receiver(ThreadingHTTPServer):
    """Keeps each message, and kills the services that send one when it is told to.

    Attributes:
        messages: headers and body of each message.
        victim: services to kill before their message is answered.
    """

    def __init__(self) -> None:
        super().__init__(("127.0.0.1", 0), Answers)
        self.messages: list[tuple[dict[str, str], bytes]] = []
        self.victim: Services | None = None


class Answers(BaseHTTPRequestHandler):
    """Answers 204, unless the sender was killed."""

    def do_POST(self) -> None:
        body = self.rfile.read(int(self.headers["content-length"]))
        headers = {name.lower(): value for name, value in self.headers.items()}
        self.server.messages.append((headers, body))
        if self.server.victim is not None:
            self.server.victim.kill()
            return
        self.send_response(204)
        self.end_headers()

    def log_message(self, *_: object) -> None:
        pass


@pytest.fixture
def receiver() -> Iterator[Receiver]:
    server = Receiver()
    thread = Thread(target=server.serve_forever, args=(0.05,))
    thread.start()
    yield server
    server.shutdown()
    server.server_close()
    thread.join()


def let_claims_run_out(stage: Stage) -> None:
    """As if the services had been away for longer than a claim holds."""
    with closing(sqlite3.connect(stage.url.removeprefix("sqlite:///"))) as connection, connection:
        connection.execute("UPDATE plugin_webhooks_deliveries SET lease_until_ms = 0, lease_ms = 0")


@pytest.mark.fault("SIGKILL of the services")
@pytest.mark.fault(
    "SIGKILL of the services between the end of a campaign and the delivery to a webhook",
    group="processes",
    outcome="The event was committed with the end of the campaign. The next services deliver it, "
    "under the same event id; one that was being sent is sent again after 45 s.",
)
def test_no_event_is_lost_and_each_has_one_id(
    stage: Stage, receiver: Receiver, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(VARIABLE, "127.0.0.0/8")
    secret, store = make_secret(), open_store(stage.url)
    url = f"http://127.0.0.1:{receiver.server_port}/hook"
    WebhookStore(store.database).create(WebhookRequest(url, (WebhookEvent.CAMPAIGN_ENDED,)), secret)
    stage.worker()
    campaigns = []
    # Before the delivery, as a rule: as soon as an end is committed, then as soon as a message is.
    for ends, question in ((1, ENDED), (2, QUEUED)):
        campaigns.append(stage.create(method="monte_carlo", episodes=20))
        services = stage.services()
        wait_until(lambda n=ends, q=question: stage.ask(q) >= n, f"{ends} campaigns have ended")
        services.kill()
        let_claims_run_out(stage)
    # During the delivery: the sender is killed by who receives its message.
    campaigns.append(stage.create(method="monte_carlo", episodes=20))
    services = receiver.victim = stage.services()
    wait_until(lambda: not services.alive, "a message was sent, and its sender was killed")
    receiver.victim = None
    let_claims_run_out(stage)
    assert stage.ask(OPEN) > 0
    services = stage.services()
    stage.finish(*campaigns)
    wait_until(
        lambda: stage.ask(QUEUED) == len(campaigns) and not stage.ask(OPEN),
        "everything is delivered",
    )
    assert services.end() == 0
    ids: dict[int, set[str]] = {campaign: set() for campaign in campaigns}
    sent = Counter[str]()
    for headers, body in receiver.messages:
        verify_message(secret, headers, body)
        data = json.loads(body)["data"]
        assert data["state"] == CampaignState.DONE
        ids[data["campaign"]].add(headers["webhook-id"])
        sent[headers["webhook-id"]] += 1
    assert [len(ids[campaign]) for campaign in campaigns] == [1] * len(campaigns)
    assert len(sent) == stage.ask(QUEUED) == len(campaigns)
    assert max(sent.values()) > 1  # the one whose sender was killed
    store.close()
