"""Bent messages at the hub's loop and the worker's: nothing escapes, hangs, or stays in memory."""

from unittest.mock import patch

import pytest
from fuzzing import MESSAGES, OVER_SOCKETS, PLACES, SEED, at_the_hub, at_the_worker
from invalid_messages import words

from eigenfail.wire.messages import PROTOCOL, Heartbeat, Hello
from eigenfail_services.hub.worker_sessions import WorkerSessions
from eigenfail_workers.worker.parent import Parent

BOUND_BYTES = 48 * 2**20
FEW = 2_000

IN_PROCESS = ("the hub", "the worker")
OVER_ZMQ = ("the hub's socket", "the worker's socket")


@pytest.mark.fault(
    "malformed, nested, lying or foreign messages",
    group="messages",
    outcome="They are refused or ignored: altered and truncated MessagePack, pickles, "
    "thousands of parts, HTTP at the hub's port. No exception leaves the hub's loop, "
    "and memory does not grow.",
)
@pytest.mark.parametrize("place", IN_PROCESS)
def test_a_hundred_thousand_bent_messages_let_nothing_escape(place: str) -> None:
    fuzz, most = PLACES[place]
    fuzzed = fuzz(most, SEED)
    assert fuzzed.messages == MESSAGES == 100_000
    assert fuzzed.escapes == ()
    assert fuzzed.answered
    assert fuzzed.grown_bytes < BOUND_BYTES


@pytest.mark.fault("malformed, nested, lying or foreign messages")
@pytest.mark.service
@pytest.mark.parametrize("place", OVER_ZMQ)
def test_some_thousands_come_over_a_true_socket(place: str) -> None:
    fuzz, most = PLACES[place]
    fuzzed = fuzz(most, SEED)
    assert fuzzed.messages == OVER_SOCKETS
    assert fuzzed.escapes == ()
    assert fuzzed.answered
    assert fuzzed.grown_bytes < BOUND_BYTES


def test_what_escapes_is_counted() -> None:
    with patch.object(WorkerSessions, "_handle_heartbeat", side_effect=RuntimeError("planted")):
        assert set(at_the_hub(FEW).escapes) == {"RuntimeError: planted"}
    with patch.object(Parent, "_handle_ack", side_effect=RuntimeError("planted")):
        assert set(at_the_worker(FEW).escapes) == {"RuntimeError: planted"}


def test_one_seed_says_the_same_words() -> None:
    sayings = (Hello(PROTOCOL, "w", 8), Heartbeat(1, 2))
    first, again, other = (list(words(sayings, seed, 500)) for seed in (1, 1, 2))
    assert first == again != other
