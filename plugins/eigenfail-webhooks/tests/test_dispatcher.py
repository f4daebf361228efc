"""Deliveries over real sockets: what is sent where, what is tried again, and when it ends."""

import json
import shutil
import socket
import ssl
import subprocess
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from threading import Event, Thread
from time import monotonic, sleep

import anyio
import deadlines
import pytest

from eigenfail.errors import StoreUnavailable
from eigenfail_services.store.clock import now_ms
from eigenfail_services.store.store import open_store
from eigenfail_webhooks import dispatcher
from eigenfail_webhooks.addresses import parse_networks
from eigenfail_webhooks.dispatcher import (
    MAX_ATTEMPTS,
    WebhookDispatcher,
    find_retry_s,
    judge_failure,
    judge_status,
    send_delivery,
)
from eigenfail_webhooks.outbox import ClaimedDelivery, Outbox
from eigenfail_webhooks.signatures import make_secret, verify_message
from eigenfail_webhooks.store import WebhookStore
from eigenfail_webhooks.values import DeliveryState, WebhookRequest

HOUR_S = 3_600.0
LOOPBACK = parse_networks("127.0.0.0/8,::1")


class Receiver(ThreadingHTTPServer):
    """A receiver on this machine that answers as it is told, and keeps what it was sent."""

    def __init__(self, answer) -> None:
        super().__init__(("127.0.0.1", 0), _Handler)
        self.answer = answer
        self.received = []


class _Handler(BaseHTTPRequestHandler):
    def do_POST(self) -> None:
        body = self.rfile.read(int(self.headers["content-length"]))
        headers = {name.lower(): value for name, value in self.headers.items()}
        self.server.received.append((self.path, headers, body))
        self.server.answer(self)

    def log_message(self, *_: object) -> None:
        pass


def answering(status, **headers):
    """An answer with a status."""

    def answer(handler) -> None:
        handler.send_response(status)
        for name, value in headers.items():
            handler.send_header(name, value)
        handler.end_headers()

    return answer


@contextmanager
def receiving(answer) -> Iterator[Receiver]:
    server = Receiver(answer)
    thread = Thread(target=server.serve_forever, args=(0.01,))
    thread.start()
    try:
        yield server
    finally:
        server.shutdown()
        server.server_close()
        thread.join()


def take_turn(store, url, allowed=LOOPBACK):
    """The secret of a webhook, and the webhook after one turn with a test delivery."""
    secret = make_secret()
    webhook = WebhookStore(store.database).create(WebhookRequest(url), secret)
    WebhookStore(store.database).test(webhook.id)
    WebhookDispatcher(store, allowed).turn()
    return secret, WebhookStore(store.database).get(webhook.id)


def attempt(store, url, allowed=LOOPBACK):
    """The secret of a webhook, and its test delivery after one turn of a dispatcher."""
    secret, webhook = take_turn(store, url, allowed)
    return secret, webhook.deliveries[0]


def test_the_delays_are_four_times_as_long_each_time_up_to_six_hours():
    delays = [find_retry_s(number) for number in range(1, MAX_ATTEMPTS)]
    assert delays == [5.0 * 4**power for power in range(7)] + [6 * HOUR_S] * 2
    assert sum(delays) / HOUR_S == pytest.approx(19.6, abs=0.05)


def test_after_the_last_attempt_it_has_failed():
    outcomes = [judge_failure("It broke.", number) for number in range(1, MAX_ATTEMPTS + 2)]
    pending = [each.state is DeliveryState.PENDING for each in outcomes]
    assert pending == [True] * (MAX_ATTEMPTS - 1) + [False] * 2
    assert outcomes[2].retry_ms == 80_000


@pytest.mark.parametrize("status", [100, 199, 300, 301, 307, 400, 404, 429, 500, 503])
def test_only_answers_of_success_are_deliveries(status):
    assert judge_status(status, 1).state is DeliveryState.PENDING
    assert judge_status(status, MAX_ATTEMPTS).state is DeliveryState.FAILED


def test_what_arrives_is_signed_and_is_what_was_written(store):
    with receiving(answering(204)) as receiver:
        url = f"http://localhost:{receiver.server_port}/hook?to=ops"
        secret, delivery = attempt(store, url)
    [(path, headers, body)] = receiver.received
    assert path == "/hook?to=ops"
    assert headers["host"] == f"localhost:{receiver.server_port}"
    assert headers["content-type"] == "application/json"
    assert headers["webhook-id"] == delivery.event
    verify_message(secret, headers, body)
    message = json.loads(body)
    assert (message["type"], message["data"]) == ("webhook.test", {"webhook": 1})
    assert (delivery.state, delivery.status, delivery.attempts) == ("delivered", 204, 1)
    assert not any("authorization" in name for name in headers)


@pytest.mark.fault(
    "webhook to a private address, by name, number, redirect or changing names",
    group="api",
    outcome="No connection is made, and the attempt has failed. The operator can allow networks.",
)
def test_a_private_address_is_not_even_connected_to(store):
    with receiving(answering(204)) as receiver:
        _, delivery = attempt(store, f"http://127.1:{receiver.server_port}/", ())
    assert receiver.received == []
    assert (delivery.state, delivery.attempts, delivery.status) == ("pending", 1, None)
    assert "127.0.0.1 is not a public address" in delivery.problem


@pytest.mark.fault("webhook to a private address, by name, number, redirect or changing names")
def test_a_name_is_resolved_once_and_that_address_is_connected_to(store, monkeypatch):
    """The second answer of a rebinding resolver would lead elsewhere: it is never asked for."""
    resolve, asked = socket.getaddrinfo, []

    def rebinding(host, *more, **options):
        if host != "hooks.example":
            return resolve(host, *more, **options)
        asked.append(host)
        address = "127.0.0.1" if len(asked) == 1 else "127.0.0.2"
        return resolve(address, *more, **options)

    monkeypatch.setattr(socket, "getaddrinfo", rebinding)
    with receiving(answering(200)) as receiver:
        _, delivery = attempt(store, f"http://hooks.example:{receiver.server_port}/")
    assert delivery.state == "delivered"
    assert asked == ["hooks.example"]
    assert receiver.received[0][1]["host"] == f"hooks.example:{receiver.server_port}"


@pytest.mark.fault("webhook to a private address, by name, number, redirect or changing names")
def test_redirects_are_not_followed(store):
    with receiving(answering(204)) as target:
        location = f"http://127.0.0.1:{target.server_port}/"
        with receiving(answering(307, Location=location)) as receiver:
            _, delivery = attempt(store, f"http://127.0.0.1:{receiver.server_port}/")
    assert target.received == []
    assert (delivery.state, delivery.status) == ("pending", 307)
    assert "not followed" in delivery.problem


def test_an_address_that_is_gone_is_told_nothing_more(store):
    with receiving(answering(410)) as receiver:
        _, webhook = take_turn(store, f"http://127.0.0.1:{receiver.server_port}/")
    assert webhook.deliveries[0].state == "failed"
    assert not webhook.active


def test_an_answer_to_a_lost_claim_deactivates_nothing(store, monkeypatch):
    monkeypatch.setattr(Outbox, "conclude", lambda *_: False)
    with receiving(answering(410)) as receiver:
        _, webhook = take_turn(store, f"http://127.0.0.1:{receiver.server_port}/")
    assert (len(receiver.received), webhook.deliveries[0].state) == (1, "pending")
    assert webhook.active


def test_a_proxy_of_the_environment_is_not_used(store, monkeypatch):
    monkeypatch.setenv("HTTP_PROXY", "http://127.0.0.1:9")
    monkeypatch.setenv("ALL_PROXY", "http://127.0.0.1:9")
    with receiving(answering(204)) as receiver:
        _, delivery = attempt(store, f"http://127.0.0.1:{receiver.server_port}/")
    assert delivery.state == "delivered"


def test_a_body_without_end_is_not_read(store):
    left = Event()

    def endless(handler) -> None:
        answering(200)(handler)
        try:
            while True:
                handler.wfile.write(b"x" * 65_536)
        except OSError:
            left.set()

    with receiving(endless) as receiver:
        _, delivery = attempt(store, f"http://127.0.0.1:{receiver.server_port}/")
        assert left.wait(deadlines.PROCESS_S)
    assert delivery.state == "delivered"


@pytest.mark.fault(
    "receiver of a webhook that does not answer, drips, or speaks no HTTP",
    group="api",
    outcome="The attempt ends after 15 s. The message is sent again, up to 10 times over 19.6 h, "
    "and is listed as failed then. Other webhooks are not held up.",
)
def test_headers_that_drip_end_with_the_attempt(store, monkeypatch):
    monkeypatch.setattr(dispatcher, "ATTEMPT_S", 0.5)
    left = Event()

    def dripping(handler) -> None:
        handler.wfile.write(b"HTTP/1.1 200 OK\r\n")
        try:
            while not left.wait(0.05):
                handler.wfile.write(b"X-Slow: 1\r\n")
        except OSError:
            left.set()

    with receiving(dripping) as receiver:
        _, delivery = attempt(store, f"http://127.0.0.1:{receiver.server_port}/")
        assert left.wait(deadlines.PROCESS_S)
    assert (delivery.state, delivery.problem) == ("pending", "No answer within 0.5 s.")


@pytest.mark.fault("receiver of a webhook that does not answer, drips, or speaks no HTTP")
def test_who_speaks_no_http_or_is_not_there_is_tried_again(store):
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
    _, closed = attempt(store, f"http://127.0.0.1:{port}/")
    with receiving(lambda handler: handler.wfile.write(b"SSH-2.0\r\n\r\n")) as receiver:
        _, other = attempt(store, f"http://127.0.0.1:{receiver.server_port}/")
        _, no_tls = attempt(store, f"https://127.0.0.1:{receiver.server_port}/")
    for delivery in (closed, other, no_tls):
        assert delivery.state == "pending"
        assert delivery.problem.startswith("The request failed: ")


def test_one_that_answers_slowly_holds_up_no_other(store, monkeypatch):
    monkeypatch.setattr(dispatcher, "ATTEMPT_S", deadlines.PROCESS_S)
    reached = Event()

    def reach(handler) -> None:
        reached.set()
        answering(204)(handler)

    def wait(handler) -> None:
        # It answers only once the other webhook was reached.
        answering(204 if reached.wait(deadlines.PROCESS_S) else 500)(handler)

    with receiving(wait) as slow, receiving(reach) as quick:
        made = [
            WebhookStore(store.database).create(
                WebhookRequest(f"http://127.0.0.1:{each.server_port}/"), make_secret()
            )
            for each in (slow, quick)
        ]
        for webhook in made:
            WebhookStore(store.database).test(webhook.id)
        WebhookDispatcher(store, LOOPBACK).turn()
    states = [WebhookStore(store.database).get(each.id).deliveries[0].state for each in made]
    assert states == ["delivered", "delivered"]


HANGING = 49
"""As many as there may be beside a good one."""

SOON_S = dispatcher.ATTEMPT_S / 2
"""Before the first of the others is given up; on an idle machine it takes half a second."""


def send_beside_hanging(store, hanging, good):
    """Return how long the good one's event took, beside events for hanging ones [s]."""
    hooks = [*hanging, good]
    secret = make_secret()
    made = [WebhookStore(store.database).create(WebhookRequest(url), secret) for url in hooks]
    for webhook in made:
        WebhookStore(store.database).test(webhook.id)
    began_s, stopping = monotonic(), Event()
    sending = Thread(target=WebhookDispatcher(store, LOOPBACK, stopping).run)
    sending.start()
    try:
        while WebhookStore(store.database).get(made[-1].id).deliveries[0].state == "pending":
            assert monotonic() - began_s < deadlines.PROCESS_S
            sleep(0.02)
        return monotonic() - began_s
    finally:
        stopping.set()
        sending.join()


def test_receivers_that_hang_do_not_delay_a_good_one(store):
    with (
        socket.create_server(("127.0.0.1", 0), backlog=128) as silent,
        receiving(answering(204)) as good,
    ):
        hanging = [f"http://127.0.0.1:{silent.getsockname()[1]}/{n}" for n in range(HANGING)]
        took_s = send_beside_hanging(store, hanging, f"http://127.0.0.1:{good.server_port}/")
    assert took_s < SOON_S


def test_names_that_no_server_resolves_do_not_delay_a_good_one(store, monkeypatch):
    over, resolve = Event(), socket.getaddrinfo

    def hang(host, *rest, **named):
        if str(host).endswith(".example"):
            over.wait(deadlines.PROCESS_S)
        return resolve(host, *rest, **named)

    monkeypatch.setattr(socket, "getaddrinfo", hang)
    with receiving(answering(204)) as good:
        hanging = [f"http://host{n}.example/" for n in range(HANGING)]
        try:
            took_s = send_beside_hanging(store, hanging, f"http://127.0.0.1:{good.server_port}/")
        finally:
            over.set()
    assert took_s < SOON_S


def take_turns(store) -> None:
    """Turns of a dispatcher until nothing is due."""
    sending = WebhookDispatcher(store, LOOPBACK)
    while WebhookStore(store.database).outbox.has_due(now_ms()):
        sending.turn()


@pytest.mark.fault("two services on one database")
def test_two_services_send_each_event_once(postgres_url):
    """Both claim from one PostgreSQL at once; where none dies, nothing is sent twice."""
    stores = [open_store(postgres_url) for _ in range(2)]
    with receiving(answering(204)) as receiver:
        url = f"http://127.0.0.1:{receiver.server_port}/"
        for _ in range(6):
            webhook = WebhookStore(stores[0].database).create(WebhookRequest(url), make_secret())
            for _ in range(4):
                WebhookStore(stores[0].database).test(webhook.id)
        with ThreadPoolExecutor(2) as pool:
            list(pool.map(take_turns, stores))
    for store in stores:
        store.close()
    sent = Counter(headers["webhook-id"] for _, headers, _ in receiver.received)
    assert len(sent) == 24
    assert {*sent.values()} == {1}


def test_turns_go_on_after_a_database_that_was_away(store, monkeypatch):
    monkeypatch.setattr(dispatcher, "RETRY_S", 0.01)
    monkeypatch.setattr(dispatcher, "TURN_S", 0.01)
    answers, stopping = iter([StoreUnavailable("It is away.", "Wait.")] * 2), Event()

    def claim(*_):
        for error in answers:
            raise error
        stopping.set()

    sending = WebhookDispatcher(store, (), stopping)
    monkeypatch.setattr(Outbox, "has_due", lambda *_: True)
    monkeypatch.setattr(Outbox, "claim", claim)
    sending.run()
    assert next(answers, None) is None


def test_a_secret_that_was_damaged_fails_its_own_delivery(store):
    webhook = WebhookStore(store.database).create(WebhookRequest("http://127.0.0.1:9/"), "damaged!")
    WebhookStore(store.database).test(webhook.id)
    WebhookDispatcher(store, LOOPBACK).turn()
    (found,) = WebhookStore(store.database).get(webhook.id).deliveries
    assert (found.state, found.attempts) == ("pending", 1)
    assert "damaged" not in found.problem


@pytest.mark.skipif(not shutil.which("openssl"), reason="makes the certificate")
def test_a_certificate_must_be_of_the_name_and_not_of_the_address(tmp_path, monkeypatch):
    resolve = socket.getaddrinfo
    monkeypatch.setattr(
        socket,
        "getaddrinfo",
        lambda _host, *more, **options: resolve("127.0.0.1", *more, **options),
    )
    certificate, key = tmp_path / "certificate.pem", tmp_path / "key.pem"
    words = ["openssl", "req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:P-256"]
    words += ["-nodes", "-keyout", key, "-out", certificate, "-days", "2", "-subj", "/CN=hooks"]
    words += ["-addext", "subjectAltName=DNS:hooks.example"]
    subprocess.run(words, check=True, capture_output=True)
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.load_cert_chain(certificate, key)
    trusting = ssl.create_default_context(cafile=str(certificate))
    with receiving(answering(200)) as receiver:
        receiver.socket = context.wrap_socket(receiver.socket, server_side=True)
        outcomes = {}
        for host, tls in (
            ("hooks.example", trusting),
            ("other.example", trusting),
            ("127.0.0.1", trusting),
            ("hooks.example.", ssl.create_default_context()),
        ):
            url = f"https://{host}:{receiver.server_port}/"
            claimed = ClaimedDelivery(1, "token", 1, "evt_1", "{}", 1, url, make_secret())
            outcomes[host] = anyio.run(send_delivery, claimed, LOOPBACK, tls)
    assert outcomes.pop("hooks.example").state == "delivered"
    assert all("CERTIFICATE_VERIFY_FAILED" in each.problem for each in outcomes.values())
