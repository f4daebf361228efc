"""Messages that no peer of ours would say, by the hundred thousand: the same ones for one seed.

Each begins as a true message and is bent in one place or in several: its bytes, its fields, or its
sense. Among them are some that are quite in order, said by the wrong one or at the wrong time.
"""

from collections.abc import Callable, Iterator, Sequence
from copy import deepcopy
from math import inf, nan
from random import Random
from typing import Any

import msgspec

from eigenfail.wire.messages import Message, encode

LIES = (
    b"\xdd\xff\xff\xff\xff",
    b"\xdf\xff\xff\xff\xff",
    b"\xc6\xff\xff\xff\xff",
    b"\xdb\xff\xff\xff\xff",
)
"""Headers of arrays, maps, bytes and texts of four thousand million elements."""

FOREIGN = (
    b"",
    b"\xc1",
    b"\x00" * 64,
    b"GET / HTTP/1.1\r\nHost: hub\r\n\r\n",
    b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03",
    b'{"type": "Hello", "protocol": 3, "worker": "json", "credit": 1}',
    b"\x80\x04\x95\x13\x00\x00\x00\x00\x00\x00\x00}\x94\x8c\x04type\x94\x8c\x05Hello\x94s.",
    b"cos\nsystem\n(S'exit 1'\ntR.",
)
"""Of other protocols; the last two are pickles, of which the second would run a command."""

ODD: tuple[Any, ...] = (
    *(None, True, nan, inf, -inf, 0, -1, 1.5, 1e308, -(2**63), 2**31, 2**63 - 1, 2**64 - 1),
    *(
        "",
        "\x00",
        "x" * 10_000,
        "hub",
        b"",
        b"\xff" * 100,
        [],
        [[]],
        {},
        {"type": "Hello"},
        [[1e300]],
    ),
)
"""In the place of any value."""

LARGE = 2**62
DEPTHS = (10, 70, 3_000)

Bend = Callable[[Random, bytes], bytes]


def words(sayings: Sequence[Message], seed: int, n: int) -> Iterator[bytes]:
    """The bytes of n messages, bent and true, made from some that are in order."""
    random = Random(seed)
    true = [encode(saying) for saying in sayings]
    for _ in range(n):
        yield random.choice(BENDS)(random, random.choice(true))


def as_it_is(_random: Random, data: bytes) -> bytes:
    """A true message, once more."""
    return data


def cut_short(random: Random, data: bytes) -> bytes:
    """Only its beginning."""
    return data[: random.randrange(len(data))]


def flip_bits(random: Random, data: bytes) -> bytes:
    """One to eight bits are others."""
    bent = bytearray(data)
    for _ in range(random.randint(1, 8)):
        bent[random.randrange(len(bent))] ^= 1 << random.randrange(8)
    return bytes(bent)


def lie_of_length(random: Random, data: bytes) -> bytes:
    """Somewhere something is said to be as long as can be said."""
    at = random.randrange(len(data))
    return data[:at] + random.choice(LIES) + data[at + 1 :]


def nest(random: Random, data: bytes) -> bytes:
    """Somewhere a list or a map lies in another, again and again."""
    at = random.randrange(len(data))
    return data[:at] + random.choice((b"\x91", b"\x81\xa1a")) * random.choice(DEPTHS) + data[at:]


def repeat(random: Random, data: bytes) -> bytes:
    """A part of it, or all, stands there twice."""
    begin, end = sorted(random.choices(range(len(data) + 1), k=2))
    return data[:end] + data[begin:]


def foreign(random: Random, _data: bytes) -> bytes:
    """Another protocol, or none."""
    return random.choice((*FOREIGN, random.randbytes(random.randrange(200))))


def change_values(random: Random, data: bytes) -> bytes:
    """One value or a few are odd ones, are gone, or stand under another name."""
    told = msgspec.msgpack.decode(data)
    for _ in range(random.choice((1, 1, 1, 2, 5))):
        place, key = random.choice(list(places(told)))
        random.choice(CHANGES)(random, place, key)
    return msgspec.msgpack.encode(told)


def places(told: Any) -> Iterator[tuple[Any, Any]]:
    """Everything in a message: what it lies in, and under which key or index."""
    keys = list(told) if isinstance(told, dict) else range(len(told))
    for key in keys:
        yield told, key
        if isinstance(told[key], dict | list):
            yield from places(told[key])


def put_odd(random: Random, place: Any, key: Any) -> None:
    """Another value."""
    place[key] = deepcopy(random.choice(ODD))


def put_near(random: Random, place: Any, key: Any) -> None:
    """A number near by: another campaign, episode, protocol, policy; an array of another shape."""
    old = place[key]
    numeric = isinstance(old, int | float) and abs(old) < LARGE
    place[key] = old + random.choice((-1, 1, 7, 1_000)) if numeric else [old, old]


def put_floats(random: Random, place: Any, key: Any) -> None:
    """In the place of an array's bytes, numbers that are none, or other bytes."""
    quads = (b"\x00\x00\xc0\x7f", b"\x00\x00\x80\x7f", b"\x00\x00\x80\xff", b"\xff\xff\x7f\x7f")
    old = place[key]
    place[key] = random.choice(quads) * (len(old) // 4) if isinstance(old, bytes) else b"\x01"


def take_away(_random: Random, place: Any, key: Any) -> None:
    """Gone; in a list, empty."""
    if isinstance(place, dict) and len(place) > 1:
        del place[key]
    else:
        place[key] = None


def add_field(random: Random, place: Any, _key: Any) -> None:
    """A field that nobody knows."""
    if isinstance(place, dict):
        place[f"unknown{random.randrange(10)}"] = deepcopy(random.choice(ODD))


CHANGES = (put_odd, put_near, put_floats, take_away, add_field)
BENDS: tuple[Bend, ...] = (
    *(as_it_is, cut_short, flip_bits, lie_of_length, nest, repeat, foreign),
    *(change_values, change_values, change_values),
)
