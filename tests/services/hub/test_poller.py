"""Whoever speaks ends the wait, whoever is to be heard by then."""

import pytest
import zmq

from eigenfail_services.hub.transport import Poller

LONG_MS = 60_000


@pytest.fixture
def pairs():
    """Sockets to hear, and those at their other ends."""
    context = zmq.Context()
    made = []
    for place in range(2):
        hears, says = context.socket(zmq.PAIR), context.socket(zmq.PAIR)
        hears.bind(f"inproc://pair-{place}")
        says.connect(f"inproc://pair-{place}")
        made.append((hears, says))
    yield made
    context.destroy(linger=0)


def test_a_word_of_anybody_ends_the_wait(pairs):
    poller, (patient, urgent) = Poller(), [hears for hears, _ in pairs]
    for hears, says in pairs:
        says.send(b"word")
        poller.wait([patient], [urgent], LONG_MS)
        assert hears.recv(zmq.NOBLOCK) == b"word"


def test_who_comes_later_is_heard_and_who_has_left_is_not(pairs):
    poller = Poller()
    (first, first_says), (second, second_says) = pairs
    poller.wait([first], [], 0)
    first_says.send(b"to nobody")
    poller.wait([second], [], 0)
    second_says.send(b"word")
    poller.wait([second], [], LONG_MS)
    assert second.recv(zmq.NOBLOCK) == b"word"


def test_a_socket_that_was_closed_does_not_disturb(pairs):
    poller = Poller()
    (first, _), (second, second_says) = pairs
    poller.wait([first, second], [], 0)
    first.close()
    second_says.send(b"word")
    poller.wait([second], [], LONG_MS)
    assert second.recv(zmq.NOBLOCK) == b"word"


def test_the_urgent_are_heard_at_once_and_the_others_together(pairs, monkeypatch):
    monkeypatch.setattr("eigenfail_services.hub.transport.MIN_INTERVAL_S", LONG_MS / 1_000)
    poller = Poller()
    (patient, patient_says), (urgent, urgent_says) = pairs
    poller.wait([patient], [urgent], 0)
    patient_says.send(b"not yet")
    urgent_says.send(b"now")
    poller.wait([patient], [urgent], LONG_MS)
    assert urgent.recv(zmq.NOBLOCK) == b"now"


def test_workers_are_heard_together_also_where_nobody_is_urgent(pairs, monkeypatch):
    slept_s: list[float] = []
    monkeypatch.setattr("eigenfail_services.hub.transport.MIN_INTERVAL_S", LONG_MS / 1_000)
    monkeypatch.setattr("eigenfail_services.hub.transport.time.sleep", slept_s.append)
    poller, ((patient, patient_says), _) = Poller(), pairs
    patient_says.send(b"word")
    for _ in range(2):
        poller.wait([patient], [], LONG_MS)
    assert slept_s[0] == 0.0
    assert slept_s[1] > LONG_MS / 2_000
