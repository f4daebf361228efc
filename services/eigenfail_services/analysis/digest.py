"""The fingerprint of an analysis."""

import hashlib

import msgspec
from msgspec import msgpack
from msgspec.structs import replace

from eigenfail.values import AnalysisResult
from eigenfail.values.arrays import encode_array


def result_digest(result: AnalysisResult) -> str:
    """SHA-256 over the numbers of a result: the same whenever the analysis is repeated.

    Words are left out: the planner's account in them is given only where workers are installed, and
    only by a planner that answers in time. So are bands: they follow from labels and noise, and
    without them an analysis has the digest that it had before there were any.
    """
    numbers = msgspec.to_builtins(
        replace(result, words=(), digest=""), enc_hook=encode_array, builtin_types=(bytes,)
    )
    for mode in numbers["modes"]:
        del mode["band"]
    return hashlib.sha256(msgpack.encode(numbers)).hexdigest()
