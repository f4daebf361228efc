"""float32 values held in Python's floats."""

from struct import Struct

_SINGLE = Struct("<f")


def to_float32(value: float) -> float:
    """The float32 nearest to a value, held exactly.

    Raises:
        OverflowError: the value is beyond what float32 holds.
    """
    (rounded,) = _SINGLE.unpack(_SINGLE.pack(value))
    return float(rounded)
