"""What a worker says that it holds, so that a hub which has just begun leaves it there."""

from hashlib import sha256
from typing import Annotated

import msgspec

from eigenfail.values import EpisodeSetup, EpisodeTask
from eigenfail.values.arrays import encode_array

MAX_CLAIMS = 4_096
"""How many episodes a worker may name at a time: many times what it is leased."""

FINGERPRINT_BYTES = 16

Number = Annotated[int, msgspec.Meta(ge=0)]
Fingerprint = Annotated[bytes, msgspec.Meta(max_length=FINGERPRINT_BYTES)]

FINISHED = b""
"""The fingerprint of what is run already: its result comes, and is judged like any other."""

_encoder = msgspec.msgpack.Encoder(enc_hook=encode_array, order="deterministic")


class Claim(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """An episode that a worker holds, and which task that is."""

    campaign: Number
    index: Number
    task: Fingerprint = FINISHED


def fingerprint(setup: EpisodeSetup, task: EpisodeTask) -> bytes:
    """The same for two tasks if they are the same function, so that one result is the other's.

    It covers all that an episode depends on: setup, index, seed and source. A policy is named by
    its version alone, which is a function of the campaign's seed and earlier rounds.
    """
    return sha256(_encoder.encode((setup, task))).digest()[:FINGERPRINT_BYTES]


def same_task(one: EpisodeTask, other: EpisodeTask) -> bool:
    """Whether two tasks of one campaign are the same function."""
    return _encoder.encode(one) == _encoder.encode(other)
