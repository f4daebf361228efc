"""The probe: what a bridge offers is known as long as it is there, and no session stays open."""

import time
from collections.abc import Iterator
from contextlib import ExitStack, closing, contextmanager

import deadlines
import pytest
import zmq
from msgspec.msgpack import decode, encode

from eigenfail.bridges import MAX_OFFER_BYTES, BridgeOffer
from eigenfail_workers.bridge import probe as probing
from eigenfail_workers.bridge.probe import BridgeProbe, make_probe

WELCOME = {
    "type": "welcome",
    "protocol": 2,
    "name": "b",
    "version": "1",
    "slots": 1,
    "scenarios": [{"name": "road", "dt_s": 0.1, "steps": 50, "parameters": {"gap_m": 9.0}}],
    "planners": [{"name": "driver"}],
    "channels": ["missed"],
    "signals": [{"name": "gap_m"}],
}
CLOSED = {"type": "closed", "id": 1}


class Scripted:
    """A bridge that answers what it is told to, and keeps what it was asked."""

    def __init__(self, address: str) -> None:
        self.socket = zmq.Context.instance().socket(zmq.REP)
        self.socket.bind(address)
        self.asked: list[dict[str, object]] = []

    def answer(self, *said: object) -> None:
        for each in said:
            assert self.socket.poll(1000 * deadlines.PROCESS_S)
            self.asked.append(decode(self.socket.recv()))
            self.socket.send(each if isinstance(each, bytes) else encode(each))

    def close(self) -> None:
        self.socket.close(linger=0)


@pytest.fixture
def address(tmp_path) -> str:
    return f"ipc://{tmp_path}/b"


@pytest.fixture
def probe(address) -> Iterator[BridgeProbe]:
    made = BridgeProbe(address)
    yield made
    made.close()


@contextmanager
def serving(address: str) -> Iterator[Scripted]:
    bridge = Scripted(address)
    try:
        yield bridge
    finally:
        bridge.close()


def update_until(probe: BridgeProbe, holds, **how: bool) -> None:
    until_s = time.monotonic() + deadlines.PROCESS_S
    while not holds():
        assert time.monotonic() < until_s
        probe.update(**{"may_ask": True, **how})
        time.sleep(0.01)


def converse(probe: BridgeProbe, bridge: Scripted, *said: object) -> None:
    """Let the probe ask, and answer it."""
    for each in said:
        update_until(probe, lambda: bridge.socket.poll(0))
        bridge.answer(each)


def test_the_offer_is_known_and_the_session_closed(probe, address) -> None:
    with serving(address) as bridge:
        converse(probe, bridge, WELCOME)
        update_until(probe, lambda: probe.offer is not None)
        converse(probe, bridge, CLOSED)
        hello, close = bridge.asked
        assert (hello["type"], close["type"]) == ("hello", "close")
        assert hello["session"] == close["session"]
        offer = probe.offer
        assert isinstance(offer, BridgeOffer)
        assert (offer.name, offer.channels, offer.signals) == ("b", ("missed",), ("gap_m",))
        assert offer.scenarios[0].parameters == ("gap_m",)
        assert not probe.update(may_ask=True)
        assert probe.offer is offer


def test_a_bridge_that_comes_back_is_asked_anew(probe, address) -> None:
    with serving(address) as bridge:
        converse(probe, bridge, WELCOME, CLOSED)
        assert probe.offer is not None
    update_until(probe, lambda: probe.offer is None)
    with serving(address) as bridge:
        converse(probe, bridge, WELCOME | {"name": "another"})
        update_until(probe, lambda: probe.offer is not None)
        assert probe.offer.name == "another"


def test_a_late_welcome_of_a_lost_bridge_is_not_that_of_the_next_one(
    probe, address, monkeypatch
) -> None:
    list_events = probe._list_events

    def lose_bridge() -> list[int]:
        """Let the welcome arrive, and then another bridge, between two reads of the probe."""
        monkeypatch.setattr(probe, "_list_events", list_events)
        first.answer(WELCOME)
        assert probe._socket.poll(1000 * deadlines.PROCESS_S)
        first.close()
        stack.enter_context(closing(second := Scripted(address)))
        bridges.append(second)
        events: list[int] = []
        while zmq.EVENT_HANDSHAKE_SUCCEEDED not in events:
            assert probe._monitor.poll(1000 * deadlines.PROCESS_S)
            events.extend(list_events())
        return events

    bridges: list[Scripted] = []
    with ExitStack() as stack:
        first = stack.enter_context(serving(address))
        update_until(probe, lambda: first.socket.poll(0))
        monkeypatch.setattr(probe, "_list_events", lose_bridge)
        for _ in range(5):
            probe.update(may_ask=True)
            assert probe.offer is None
        converse(probe, bridges[0], WELCOME | {"name": "another"})
        update_until(probe, lambda: probe.offer is not None)
        assert probe.offer.name == "another"


def test_nothing_is_asked_while_episodes_may_run_there(probe, address) -> None:
    with serving(address) as bridge:
        update_until(probe, lambda: probe._is_connected, may_ask=False)
        for _ in range(20):
            assert not probe.update(may_ask=False)
        assert not bridge.socket.poll(50)
        converse(probe, bridge, WELCOME)


def test_a_bridge_without_room_is_asked_again_later(probe, address, monkeypatch) -> None:
    monkeypatch.setattr(probing, "ASK_AGAIN_S", 0.0)
    with serving(address) as bridge:
        full = {"type": "refusal", "reason": "full", "full": True}
        converse(probe, bridge, full, full, WELCOME)
        update_until(probe, lambda: probe.offer is not None)


LONG = {f"{number:0190}": 0.5 for number in range(MAX_OFFER_BYTES // 190)}


@pytest.mark.parametrize(
    ("said", "closes"),
    [
        (b"\xc1", 0),
        ({"type": "welcome", "protocol": 2}, 0),
        ({"type": "refusal", "reason": "I do not like it."}, 0),
        (CLOSED, 0),
        (WELCOME | {"protocol": 3}, 1),
        (WELCOME | {"scenarios": [WELCOME["scenarios"][0] | {"parameters": LONG}]}, 1),
    ],
    ids=["garbage", "half", "refusal", "other", "protocol 3", "too long"],
)
def test_what_is_no_offer_is_none_and_is_not_asked_for_again(probe, address, said, closes) -> None:
    with serving(address) as bridge:
        converse(probe, bridge, said)
        for _ in range(20):
            assert not probe.update(may_ask=True)
            time.sleep(0.01)
        assert probe.offer is None
        converse(probe, bridge, *[CLOSED] * closes)
        assert not bridge.socket.poll(50)
        assert [each["type"] for each in bridge.asked[1:]] == ["close"] * closes


@pytest.mark.parametrize("address", [None, "", "tcp://192.0.2.1:9000", "not an address"])
def test_a_bridge_that_may_not_be_connected_to_is_not_asked(address) -> None:
    assert make_probe(address) is None
