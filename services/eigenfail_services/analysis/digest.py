"""The fingerprint of an analysis."""

import hashlib

from msgspec import msgpack
from msgspec.structs import replace

from eigenfail.values import AnalysisResult
from eigenfail.values.arrays import encode_array


def result_digest(result: AnalysisResult) -> str:
    """SHA-256 over every number of a result: the same whenever the analysis is repeated.

    Words are left out: the planner's account in them is given only where workers are installed, and
    only by a planner that answers in time.
    """
    numbers = replace(result, words=(), digest="")
    return hashlib.sha256(msgpack.encode(numbers, enc_hook=encode_array)).hexdigest()
