"""A server on a true socket under more than it can do: it answers, refuses, and stays small."""

import os
import socket
import subprocess
import sys
import time
from collections import Counter
from contextlib import ExitStack
from pathlib import Path

import anyio
import deadlines
import httpx2
import psutil
import pytest
from sqlalchemy import create_engine, insert, update

from eigenfail.client import Client
from eigenfail_services.store.schema import event_counter, events
from eigenfail_services.store.store import open_store

pytestmark = pytest.mark.service

CLIENTS = 200
WAVES = 2
PATIENCE_S = deadlines.PROCESS_S
ANSWERS = {200, 201}
REFUSALS = {429, 503}
GROWN_BYTES = 128 * 2**20

EVENTS = 8_000
SAID = "x" * 2_000
DEAF = 24
SHOWN_BYTES = EVENTS * len(SAID)
"""What each of the deaf was to read; all of them together far more than `GROWN_BYTES`."""


class Server:
    """An API process on a database of its own."""

    def __init__(self, folder: Path) -> None:
        self.database = f"sqlite:///{folder}/e.db"
        self.log = folder / "log"
        with self.log.open("w") as log:
            self.process = subprocess.Popen(
                [sys.executable, "-m", "eigenfail_api", "--port", "0", "--database", self.database],
                env={**os.environ, "EIGENFAIL_POLL_S": "0.02"},
                stdout=subprocess.PIPE,
                stderr=log,
                text=True,
            )
        self.url = self.process.stdout.readline().split()[-1]
        self.host, port = self.url.removeprefix("http://").split(":")
        self.port = int(port)

    def resident_bytes(self) -> int:
        return psutil.Process(self.process.pid).memory_info().rss

    def connections(self) -> int:
        """That are not yet closed."""
        sockets = psutil.Process(self.process.pid).net_connections("tcp")
        return sum(each.status != psutil.CONN_LISTEN for each in sockets)

    def end(self) -> None:
        self.process.terminate()
        self.process.communicate(timeout=PATIENCE_S)


@pytest.fixture
def server(tmp_path):
    running = Server(tmp_path)
    yield running
    running.end()


async def visit(http, fields, seen, key):
    """One client: looks round, launches a campaign, looks at it."""
    for path in ("/api/v1/campaigns", "/"):
        seen.append((await http.get(path)).status_code)
    launch = {"Idempotency-Key": key}
    made = await http.post("/api/v1/campaigns", json=fields, headers=launch)
    seen.append(made.status_code)
    if made.status_code == 201:
        path = f"/api/v1/campaigns/{made.json()['id']}/summary"
        seen.append((await http.get(path)).status_code)


async def crowd(server, fields, wave):
    """How often which status was answered to all of them at once, each on its own connection."""
    seen = []
    each = httpx2.Limits(max_connections=CLIENTS)
    async with (
        httpx2.AsyncClient(base_url=server.url, timeout=PATIENCE_S, limits=each) as http,
        anyio.create_task_group() as group,
    ):
        for number in range(CLIENTS):
            group.start_soon(visit, http, fields, seen, f"{wave}/{number}")
    return Counter(seen)


@pytest.mark.fault(
    "two hundred clients at once",
    group="api",
    outcome="Each request is answered or refused; memory stays from one crowd to the next.",
)
def test_two_hundred_clients_at_once_are_answered_or_refused(server, fields):
    resident, seen = [], Counter()
    for wave in range(WAVES):
        seen += anyio.run(crowd, server, fields, wave)
        resident.append(server.resident_bytes())
    assert seen.keys() <= ANSWERS | REFUSALS, seen
    assert seen[200] > CLIENTS
    assert resident[-1] - resident[0] < GROWN_BYTES, resident
    with Client(server.url) as client:
        assert client.health()
        assert len(list(client.campaigns.list())) == seen[201]


@pytest.fixture
def full_log(server):
    """Very many events in the log."""
    open_store(server.database).close()
    engine = create_engine(server.database)
    rows = (
        {"id": i, "at_ms": 0, "kind": "test", "state": "", "message": SAID}
        for i in range(1, EVENTS + 1)
    )
    with engine.begin() as connection:
        connection.execute(insert(events), list(rows))
        connection.execute(update(event_counter).values(last=EVENTS))
    engine.dispose()


def read_all(server):
    """The ids that a follower sees who listens."""
    with Client(server.url) as client:
        followed = client.events.follow(after=0)
        return [next(followed).id for _ in range(EVENTS)]


def deaf(server):
    """A follower that asks for everything and reads nothing."""
    made = socket.socket()
    made.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    made.connect((server.host, server.port))
    made.sendall(b"GET /api/v1/events?after=0 HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n")
    return made


@pytest.mark.fault(
    "browser that never reads its event stream",
    group="messages",
    outcome="The server buffers one batch of 500 events for it beyond the connection's own "
    "buffer; other browsers do not wait.",
)
def test_followers_that_never_read_hold_up_nobody_and_cost_little(server, full_log):
    everything = list(range(1, EVENTS + 1))
    assert read_all(server) == everything
    before = server.resident_bytes()
    assert GROWN_BYTES < DEAF * SHOWN_BYTES / 2
    with ExitStack() as stack:
        for _ in range(DEAF):
            stack.enter_context(deaf(server))
        for _ in range(2):
            assert read_all(server) == everything
        assert server.connections() >= DEAF
        assert server.resident_bytes() - before < GROWN_BYTES
        with Client(server.url) as client:
            assert client.health()
    deadline = time.monotonic() + PATIENCE_S
    while server.connections() > 0:
        assert time.monotonic() < deadline, "connections of the deaf are kept"
        time.sleep(0.05)
    assert server.log.read_text() == ""
