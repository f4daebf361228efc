"""Long messages in pieces: whole again at the other end, and bounded on the way."""

import numpy as np
import pytest
from msgspec.structs import replace

from eigenfail.errors import ProtocolError
from eigenfail.values.episode import EpisodeTask, TrajectorySource
from eigenfail.wire import messages
from eigenfail.wire.messages import (
    MAX_FRAME_BYTES,
    MAX_HOLDINGS,
    PIECE_BYTES,
    PROTOCOL,
    Ack,
    Assembler,
    Hello,
    Holding,
    Lease,
    Piece,
    encode,
    read_hub_message,
    split,
)
from eigenfail_services.hub.worker_sessions import AssemblerTable


def lease(steps: int) -> Lease:
    z = np.arange(2 * steps, dtype=np.float32).reshape(steps, 2)
    return Lease(1, (EpisodeTask(0, 7, TrajectorySource(z)),))


LONG = lease(5_000)


def pieces_of(message: Lease) -> list[Piece]:
    return [read_hub_message(frame) for frame in split(message)]  # type: ignore[misc]


def test_a_short_message_is_one_frame_as_before():
    assert list(split(Ack(1, (2, 3)))) == [encode(Ack(1, (2, 3)))]


def test_a_long_message_arrives_whole_and_in_small_frames():
    frames = list(split(LONG))
    assert max(map(len, frames)) < PIECE_BYTES + 64
    assembler = Assembler()
    joined = [assembler.add(piece) for piece in pieces_of(LONG)]
    assert joined[:-1] == [None] * (len(frames) - 1)
    assert joined[-1] == encode(LONG)
    assert assembler.held_bytes == 0


def test_other_messages_may_stand_between_pieces_and_one_message_follows_another():
    assembler = Assembler()
    for message in (LONG, lease(700), LONG):
        assert [whole for piece in pieces_of(message) if (whole := assembler.add(piece))] == [
            encode(message)
        ]


@pytest.mark.fault(
    "piece of a message that is lost, doubled or late",
    group="messages",
    outcome="The message is dropped whole, the next one arrives; its sender repeats it.",
)
@pytest.mark.parametrize("order", [[0, 2], [0, 1, 1, 2], [0, 2, 1], [1, 2]])
def test_a_message_without_one_of_its_pieces_is_dropped_whole(order):
    assembler, parts = Assembler(), pieces_of(LONG)
    shuffled = [parts[at] for at in order] + parts[3:]
    assert [assembler.add(piece) for piece in shuffled] == [None] * len(shuffled)
    assert assembler.held_bytes == 0
    assert [whole for piece in pieces_of(LONG) if (whole := assembler.add(piece))]


@pytest.mark.fault(
    "piece of a message that lies about its size",
    group="messages",
    outcome="It is refused, and nothing of the message is kept.",
)
@pytest.mark.parametrize(
    "lie",
    [
        {"data": b""},
        {"total": 10},
        {"offset": 10**9},
        {"total": 2**62},
    ],
)
def test_a_piece_that_does_not_fit_is_refused(lie):
    assembler, first = Assembler(), pieces_of(LONG)[0]
    assembler.add(first)
    with pytest.raises(ProtocolError, match="does not fit"):
        assembler.add(replace(first, **lie))
    assert assembler.held_bytes == 0


def test_a_message_that_nobody_joins_is_not_sent():
    with pytest.raises(ProtocolError, match="exceeds 5000"):
        next(split(LONG, 5_000))


def test_the_longest_greeting_fits_a_frame():
    holdings = tuple(Holding(2**62, 2**62, b"x" * 16) for _ in range(MAX_HOLDINGS))
    names = {f"{n:03}" + "\U0001f69a" * 297: "\U0001f69a" * 300 for n in range(200)}
    (frame,) = split(Hello(PROTOCOL, "w", 1, holdings=holdings, versions=names))
    assert len(frame) < MAX_FRAME_BYTES


@pytest.mark.fault(
    "flood of unfinished messages from many workers",
    group="messages",
    outcome="A hub holds 256 MiB of them at most; the longest is dropped first, others arrive.",
)
def test_unfinished_messages_of_all_connections_have_one_bound(monkeypatch):
    monkeypatch.setattr(messages, "MAX_UNFINISHED_BYTES", 10_000)
    table = AssemblerTable()
    table.add("greedy", Piece(1, 0, 50_000, b"x" * 9_000))
    table.add("modest", Piece(1, 0, 600, b"a" * 500))
    table.add("other", Piece(1, 0, 50_000, b"x" * 5_000))
    assert len(table) == 2
    assert table.add("greedy", Piece(1, 9_000, 50_000, b"x" * 500)) is None
    assert table.add("modest", Piece(1, 500, 600, b"b" * 100)) == b"a" * 500 + b"b" * 100
    table.keep_only(["modest"])
    assert len(table) == 0
