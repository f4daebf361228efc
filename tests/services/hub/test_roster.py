"""The roster: arrivals, departures, and that the others are still connected."""

import msgspec
import pytest

from eigenfail.bridges import BridgeOffer, OfferedPlanner, OfferedScenario
from eigenfail.errors import StoreUnavailable
from eigenfail.wire.messages import PROTOCOL, Hello
from eigenfail_services.hub import worker_table
from eigenfail_services.hub.worker_table import (
    HEARTBEAT_INTERVAL_S,
    ROSTER_INTERVAL_S,
    RosterWriter,
    WorkerSession,
)
from eigenfail_services.store import roster as store_roster
from eigenfail_services.store.store import open_store

LONG_AGO, LATER = 0, 4_000_000_000_000
VERSIONS = {"numpy": "2.4.6"}


class Table:
    """Worker sessions that come and go, and a clock that is set by hand."""

    def __init__(self, monkeypatch):
        self.now_s = 100.0
        self.sessions = {}
        monkeypatch.setattr(worker_table.time, "monotonic", lambda: self.now_s)
        self.roster = open_store("memory://").roster
        self.writer = RosterWriter(self.roster, self.sessions)

    def take(self, name):
        hello = Hello(PROTOCOL, name, 8, "a host", 7, versions=VERSIONS)
        self.sessions[name.encode()] = WorkerSession(hello, self.now_s)

    def pass_s(self, seconds):
        self.now_s += seconds
        self.writer.update()

    def present(self):
        return [presence.worker for presence in self.roster.present(LONG_AGO)]


@pytest.fixture
def table(monkeypatch):
    return Table(monkeypatch)


def test_arrivals_and_ends_are_noted_once(table):
    table.take("b")
    table.take("a")
    for _ in range(3):
        table.pass_s(ROSTER_INTERVAL_S)
        assert table.present() == ["a", "b"]
    told = table.roster.last("a", LATER)
    assert (told.host, told.pid, told.versions) == ("a host", 7, VERSIONS)
    del table.sessions[b"b"]
    table.pass_s(ROSTER_INTERVAL_S)
    assert table.present() == ["a"]


def test_who_comes_back_by_another_connection_has_arrived_anew(table):
    table.take("a")
    table.pass_s(ROSTER_INTERVAL_S)
    first = table.roster.last("a", LATER)
    table.take("a")
    table.pass_s(ROSTER_INTERVAL_S)
    assert table.roster.last("a", LATER).id > first.id
    assert table.present() == ["a"]


def test_those_who_stay_are_named_every_few_seconds(table, monkeypatch):
    heard = []
    monkeypatch.setattr(table.roster, "heard", lambda numbers: heard.append(len(numbers)))
    table.take("a")
    table.pass_s(ROSTER_INTERVAL_S)
    for _ in range(10):
        table.pass_s(HEARTBEAT_INTERVAL_S / 5)
    assert 2 <= len(heard) <= 3


def test_a_crowd_comes_and_goes_in_one_stroke(table, monkeypatch):
    strokes = []
    for verb in ("arrived", "left"):
        write = getattr(table.roster, verb)
        monkeypatch.setattr(
            table.roster, verb, lambda some, w=write: strokes.append(len(some)) or w(some)
        )
    for number in range(50):
        table.take(f"w{number}")
    table.pass_s(ROSTER_INTERVAL_S)
    table.sessions.clear()
    table.pass_s(ROSTER_INTERVAL_S)
    assert strokes == [50, 50]
    assert table.present() == []


def test_what_could_not_be_written_is_written_later(table, monkeypatch):
    def refuse(arrival):
        raise StoreUnavailable("The database is away.")

    table.take("a")
    with monkeypatch.context() as away:
        away.setattr(table.roster, "arrived", refuse)
        with pytest.raises(StoreUnavailable):
            table.pass_s(ROSTER_INTERVAL_S)
    table.pass_s(0.0)
    assert table.present() == ["a"]


OFFER = BridgeOffer(
    "b", "1", (OfferedScenario("road", 0.1, 10),), (OfferedPlanner("p", ("a",)),), ("speed",)
)


def test_offers_of_bridges_are_kept_while_their_workers_are_there(table):
    text = msgspec.json.encode(OFFER).decode()
    for name in ("a", "b", "c"):
        table.take(name)
    table.sessions[b"a"].offer = table.sessions[b"b"].offer = text
    table.pass_s(ROSTER_INTERVAL_S)
    assert table.roster.list_offers() == (OFFER,)
    table.sessions[b"a"].offer = None
    table.pass_s(ROSTER_INTERVAL_S)
    assert table.roster.list_offers() == (OFFER,)
    del table.sessions[b"b"]
    table.pass_s(ROSTER_INTERVAL_S)
    assert table.roster.list_offers() == ()
    assert table.present() == ["a", "c"]


def test_the_offer_of_a_killed_hub_is_deleted(table, monkeypatch):
    for name in ("a", "b"):
        table.take(name)
        table.sessions[name.encode()].offer = msgspec.json.encode(OFFER).decode()
    table.pass_s(ROSTER_INTERVAL_S)
    killed, kept = (table.roster.last(name, LATER) for name in ("a", "b"))
    later_ms = killed.heard_ms + 1_000 * (store_roster.ABANDONED_S + 1)
    monkeypatch.setattr(store_roster, "now_ms", lambda: later_ms)
    table.roster.heard([kept.id])
    RosterWriter(table.roster, {b"c": WorkerSession(Hello(PROTOCOL, "c", 8), 0.0)}).update()
    table.roster.heard([killed.id, kept.id])
    assert table.roster.list_offers() == (OFFER,)
    table.roster.left([kept.id])
    assert table.roster.list_offers() == ()


def test_an_offer_is_written_once_however_long_it_stands(table, monkeypatch):
    written = []
    write = table.roster.set_offers
    monkeypatch.setattr(
        table.roster, "set_offers", lambda offers: written.append(len(offers)) or write(offers)
    )
    table.take("a")
    table.sessions[b"a"].offer = msgspec.json.encode(OFFER).decode()
    for _ in range(3):
        table.pass_s(ROSTER_INTERVAL_S)
    assert written == [1]


def test_at_the_end_nobody_is_there(table):
    table.take("a")
    table.pass_s(ROSTER_INTERVAL_S)
    table.writer.close()
    assert table.present() == []
