"""A learner's state as bytes without pickle: raw arrays, facts, a header and a hash."""

import hashlib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from math import prod
from typing import Any, Literal, TypeVar

import msgspec
import numpy as np
from numpy.typing import NDArray

from eigenfail.errors import ProtocolError

Array = NDArray[Any]
Arrays = Mapping[str, Array]
Facts = TypeVar("Facts", bound=msgspec.Struct)

VERSION = 1


class RawArray(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """An array in its binary form: row-major, little-endian."""

    dtype: Literal["<f4", "<f8", "<i8"]
    shape: tuple[int, ...]
    data: bytes


class ArchiveBody(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Facts and arrays of a state."""

    facts: msgspec.Raw
    arrays: dict[str, RawArray]


class Archive(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The header, and the body with its SHA-256."""

    kind: str
    version: int
    sha256: bytes
    body: bytes


_archives = msgspec.msgpack.Decoder(Archive)
_bodies = msgspec.msgpack.Decoder(ArchiveBody)


def write(kind: str, facts: msgspec.Struct, arrays: Arrays) -> bytes:
    """Return the bytes of a state.

    Args:
        kind: name of the method.
        facts: values besides arrays, such as counters.
        arrays: float32, float64 or int64, by name.
    """
    # No pickle: a checkpoint comes from a database, and no data may run code (docs/reliability.md,
    # promise 9).
    raw = {name: _raw(array) for name, array in arrays.items()}
    body = msgspec.msgpack.encode(ArchiveBody(msgspec.Raw(msgspec.msgpack.encode(facts)), raw))
    return msgspec.msgpack.encode(Archive(kind, VERSION, hashlib.sha256(body).digest(), body))


def read(kind: str, data: bytes, facts: type[Facts]) -> tuple[Facts, dict[str, Array]]:
    """Return the facts and the writable arrays of a state.

    Raises:
        ProtocolError: the bytes are damaged, or are not a state of this method.
    """
    with wrap_errors(kind):
        archive = _archives.decode(data)
        if (archive.kind, archive.version) != (kind, VERSION):
            raise ValueError(f"they are {archive.kind} version {archive.version}")
        # A damaged state that can be decoded would train on quietly.
        if hashlib.sha256(archive.body).digest() != archive.sha256:
            raise ValueError("their SHA-256 does not match")
        body = _bodies.decode(archive.body)
        kept = msgspec.msgpack.decode(body.facts, type=facts)
        return kept, {name: _array(raw) for name, raw in body.arrays.items()}


@contextmanager
def wrap_errors(kind: str) -> Iterator[None]:
    """Turn exceptions during the reading of a state into a ProtocolError.

    Raises:
        ProtocolError: the block raised an exception.
    """
    try:
        yield
    # msgspec's errors of decoding and validation are ValueErrors; torch raises RuntimeError.
    except (ValueError, KeyError, TypeError, RuntimeError) as error:
        raise ProtocolError(
            f"These bytes are not a state of {kind} version {VERSION}: {error}.",
            "Restore with the method and settings that made them, or launch the campaign again.",
        ) from error


def take(arrays: Arrays, name: str, shape: tuple[int, ...]) -> Array:
    """Return one array of a state.

    Raises:
        ValueError: the array is missing or has another shape.
    """
    array = arrays.get(name)
    if array is None or array.shape != shape:
        found = "nothing" if array is None else f"shape {array.shape}"
        raise ValueError(f"'{name}' should have shape {shape}, there is {found}")
    return array


def _raw(array: Array) -> RawArray:
    little = array.astype(array.dtype.newbyteorder("<"), copy=False)
    return msgspec.convert(
        {"dtype": little.dtype.str, "shape": array.shape, "data": little.tobytes()}, RawArray
    )


def _array(raw: RawArray) -> Array:
    dtype = np.dtype(raw.dtype)
    if any(n < 0 for n in raw.shape) or prod(raw.shape) * dtype.itemsize != len(raw.data):
        raise ValueError(f"shape {raw.shape} does not fit {len(raw.data)} bytes of {raw.dtype}")
    # A copy: arrays over bytes cannot be written to.
    return np.frombuffer(raw.data, dtype).reshape(raw.shape).astype(dtype.newbyteorder("="))
