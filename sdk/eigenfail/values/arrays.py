"""numpy arrays inside frozen values: one dtype in memory, on the wire and on disk."""

from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from eigenfail.errors import ProtocolError

Floats = NDArray[np.float32]

LARGEST_FLOAT32 = float(np.finfo(np.float32).max)
"""A larger number would become infinite when it is stored or sent."""

RANGE = f"from {-LARGEST_FLOAT32:.3g} to {LARGEST_FLOAT32:.3g}"


def fits_float32(value: Any) -> bool:
    """Return whether a real number stays finite as float32; false for NaN."""
    return bool(abs(value) <= LARGEST_FLOAT32)


# 200 MB of float32, which fit into the longest message.
MAX_ELEMENTS = 50_000_000
MAX_DIMENSIONS = 4
LITTLE_ENDIAN_FLOAT = np.dtype("<f4")


class PackedArray(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A float32 array in its binary form: row-major, little-endian."""

    shape: tuple[int, ...]
    data: bytes


def pack(array: Floats) -> PackedArray:
    """Return the binary form of an array.

    Raises:
        ProtocolError: the array is not float32.
    """
    # A silent conversion would change numbers, and so the digests of results.
    if array.dtype != np.float32:
        raise ProtocolError(f"Arrays travel as float32, not {array.dtype}.", "Convert it first.")
    return PackedArray(array.shape, np.ascontiguousarray(array, LITTLE_ENDIAN_FLOAT).tobytes())


def unpack(packed: PackedArray) -> Floats:
    """Return the array of a binary form, checked before memory is allocated.

    Raises:
        ProtocolError: the shape is outside the limits, or does not fit the number of bytes.
    """
    shape, data = packed.shape, packed.data
    is_bounded, elements = len(shape) <= MAX_DIMENSIONS, 1
    # Only the first sizes: a hostile message may hold a million of them.
    for size in shape[:MAX_DIMENSIONS]:
        is_bounded = is_bounded and 0 <= size <= MAX_ELEMENTS
        elements *= size
    if not is_bounded:
        raise ProtocolError(f"An array of shape {shape} is outside what may travel.")
    if elements * LITTLE_ENDIAN_FLOAT.itemsize != len(data):
        raise ProtocolError(f"Shape {shape} does not fit {len(data)} bytes of float32.")
    # A view of the received bytes: nothing is copied, and nobody can write to it.
    return np.ndarray(shape, LITTLE_ENDIAN_FLOAT, data)


def find_lost(values: NDArray[np.float64]) -> float | None:
    """Return the first finite number that float32 cannot hold; None if there is none."""
    lost = values[np.isfinite(values) & (np.abs(values) > LARGEST_FLOAT32)]
    return float(lost[0]) if lost.size else None


def encode_array(value: Any) -> PackedArray:
    """Pack an array: the hook of msgspec's MessagePack encoder."""
    if isinstance(value, np.ndarray):
        return pack(value)
    raise TypeError(f"{type(value).__name__} does not travel")


def decode_array(_kind: Any, value: Any) -> Floats:
    """Return an array from its packed form or nested lists: the hook of msgspec's decoders."""
    if isinstance(value, list):
        # As doubles first: float32 would turn what is too large into infinity before it can be
        # seen.
        wide = np.asarray(value, np.float64)
        if (lost := find_lost(wide)) is not None:
            raise ProtocolError(f"An array holds {lost:g}. Its numbers must be {RANGE}.")
        return wide.astype(np.float32)
    return unpack(msgspec.convert(value, PackedArray))


def encode_array_as_lists(value: Any) -> Any:
    """Convert arrays and numbers of numpy for JSON: the hook of msgspec's JSON encoder."""
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    raise TypeError(f"{type(value).__name__} does not travel")
