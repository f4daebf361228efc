"""A connection to PostgreSQL that is cut between its commit and the reply: it may have been done.

What lies between is a socket of the test's own, which lets the server commit and then hangs up.
"""

import socket
import socketserver
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from threading import Event, Thread
from types import SimpleNamespace

import deadlines
import pytest
from accepted import accept_spec
from sqlalchemy import make_url
from store_checks.examples import deliver, running
from store_checks.jobs import claimed

from eigenfail.errors import StoreUnavailable
from eigenfail.testing.examples import result, spec
from eigenfail_services.campaigns import supervisor
from eigenfail_services.store.store import Store, open_store
from eigenfail_services.upkeep.verify import verify

PATIENCE_S = deadlines.PROCESS_S
CHUNK = 65_536
COMMIT = b"COMMIT\0"
PORT = ".s.PGSQL.5432"


class Line(socketserver.BaseRequestHandler):
    """Carries one connection."""

    def handle(self) -> None:
        """From the client to the server until one of them hangs up, and back in a thread."""
        server: Between = self.server  # type: ignore[assignment]
        self.hangs_up = Event()
        with socket.socket(socket.AF_UNIX) as behind:
            behind.connect(server.behind)
            back = Thread(target=self._back, args=(behind,))
            back.start()
            while words := self.request.recv(CHUNK):
                if server.armed.is_set() and COMMIT in words:
                    server.armed.clear()
                    self.hangs_up.set()
                behind.sendall(words)
            behind.shutdown(socket.SHUT_WR)
            back.join(PATIENCE_S)

    def _back(self, behind: socket.socket) -> None:
        while words := behind.recv(CHUNK):
            if self.hangs_up.is_set():  # this is the reply to the commit: it is done
                self.request.shutdown(socket.SHUT_RDWR)
                return
            self.request.sendall(words)


class Between(socketserver.ThreadingUnixStreamServer):
    """Where clients connect to; once it is armed, the next commit gets no reply.

    Attributes:
        behind: the server's own socket.
    """

    daemon_threads = True

    def __init__(self, folder: Path, behind: str) -> None:
        self.behind = behind
        self.armed = Event()
        super().__init__(str(folder / PORT), Line)


@pytest.fixture
def between(prepared_postgres_url: str, tmp_path_factory) -> Iterator[Between]:
    folder = make_url(prepared_postgres_url).query["host"]
    short = tmp_path_factory.mktemp("s")
    with Between(short, f"{folder}/{PORT}") as server:
        thread = Thread(target=server.serve_forever)
        thread.start()
        yield server
        server.shutdown()
        thread.join()


@pytest.fixture
def store(between: Between, prepared_postgres_url: str) -> Iterator[Store]:
    folder = str(Path(str(between.server_address)).parent)
    url = make_url(prepared_postgres_url).update_query_dict({"host": folder})
    with closing(open_store(url.render_as_string(hide_password=False))) as store:
        yield store


@pytest.mark.fault(
    "database connection cut between commit and reply",
    group="storage",
    outcome="Results become duplicates, a campaign is created once if the request had an "
    "`Idempotency-Key`, and active time is billed once.",
)
def test_results_that_were_kept_without_a_reply_are_duplicates(
    between: Between, store: Store, prepared_postgres_url: str
) -> None:
    campaign = running(store)
    between.armed.set()
    with pytest.raises(StoreUnavailable):
        deliver(store, campaign, result(0), result(1))
    assert deliver(store, campaign, result(0), result(1)) == ["duplicate", "duplicate"]
    assert store.campaigns.get(campaign.id).counts.completed == 2
    assert verify(prepared_postgres_url).defects == 0


@pytest.mark.fault("database connection cut between commit and reply")
def test_a_campaign_that_was_made_without_a_reply_is_made_once(
    between: Between, store: Store
) -> None:
    between.armed.set()
    with pytest.raises(StoreUnavailable):
        store.campaigns.create(accept_spec(spec()), "key")
    made = store.campaigns.create(accept_spec(spec()), "key")
    assert [each.id for each in store.campaigns.page(9).items] == [made.id]


@pytest.mark.fault("database connection cut between commit and reply")
def test_time_that_was_billed_without_a_reply_is_billed_once(
    between: Between, store: Store, monkeypatch
) -> None:
    now_s = [0.0]
    monkeypatch.setattr(supervisor, "time", SimpleNamespace(monotonic=lambda: now_s[0]))
    campaign = running(store).id
    bills = supervisor.SupervisedCampaign(claimed(store))
    now_s[0] = 100.0
    between.armed.set()
    with pytest.raises(StoreUnavailable):
        bills.bill(store)
    assert store.campaigns.get(campaign).active_s == 100.0
    now_s[0] = 110.0
    bills.bill(store)
    assert store.campaigns.get(campaign).active_s == 110.0
