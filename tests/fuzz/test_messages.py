"""Bent messages at the hub's loop and the worker's: nothing escapes, hangs, or stays in memory."""

from itertools import chain, repeat
from random import Random
from unittest.mock import DEFAULT, patch

import pytest
from benchmarks.faults.fuzzing import (
    MESSAGES,
    OVER_SOCKETS,
    PLACES,
    SEED,
    at_the_hub,
    at_the_worker,
)
from benchmarks.faults.fuzzing_bridge import WELCOME, at_the_engine, observe
from benchmarks.faults.invalid_messages import BENDS, words
from msgspec.msgpack import encode

from eigenfail.errors import SimulatorError
from eigenfail.wire.messages import PROTOCOL, Heartbeat, Hello
from eigenfail_services.hub.worker_sessions import WorkerSessions
from eigenfail_workers.bridge import engine
from eigenfail_workers.bridge.messages import Observations, SlotObservation, read_answer
from eigenfail_workers.worker.parent import Parent

BOUND_BYTES = 48 * 2**20
FEW = 2_000
MANY = 20_000

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


@pytest.mark.fault(
    "malformed, nested or false answers of a bridge",
    group="messages",
    outcome="An observation that cannot be read is a fault of its episode alone; any other answer "
    "that cannot be read ends the episodes of that worker as errored. No exception leaves the "
    "engine, which serves the next episode.",
)
def test_some_thousands_of_bent_answers_of_a_bridge_let_nothing_escape() -> None:
    assert at_the_engine(FEW) == ((), True)


def test_bent_answers_are_read_or_refused() -> None:
    slots = [observe(0), observe(1), observe(2), {"fault": "planner", "message": "No."}]
    true = [encode({"type": "observations", "id": 1, "slots": slots}), encode(dict(WELCOME))]
    random, read = Random(SEED), 0
    for _ in range(MANY):
        try:
            answer = read_answer(random.choice(BENDS)(random, random.choice(true)))
        except SimulatorError:
            continue
        read += 1
        if isinstance(answer, Observations):
            assert all(isinstance(each, SlotObservation) for each in answer.slots)
    assert MANY / 10 < read < MANY


def test_what_escapes_is_counted() -> None:
    planted = [RuntimeError("planted")] * 2
    with patch.object(engine.messages, "match_answer", wraps=engine.messages.match_answer) as match:
        match.side_effect = chain(planted, repeat(DEFAULT))
        assert at_the_engine(FEW // 100) == (("RuntimeError: planted",) * 2, True)
    with patch.object(WorkerSessions, "_handle_heartbeat", side_effect=RuntimeError("planted")):
        assert set(at_the_hub(FEW).escapes) == {"RuntimeError: planted"}
    with patch.object(Parent, "_handle_ack", side_effect=RuntimeError("planted")):
        assert set(at_the_worker(FEW).escapes) == {"RuntimeError: planted"}


def test_one_seed_says_the_same_words() -> None:
    sayings = (Hello(PROTOCOL, "w", 8), Heartbeat(1, 2))
    first, again, other = (list(words(sayings, seed, 500)) for seed in (1, 1, 2))
    assert first == again != other
