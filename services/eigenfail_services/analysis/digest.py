"""The fingerprint of an analysis."""

import hashlib

import msgspec

from eigenfail.values import AnalysisResult
from eigenfail.values.arrays import encode_array


def result_digest(result: AnalysisResult) -> str:
    """SHA-256 over every number of a result: the same whenever the analysis is repeated."""
    return hashlib.sha256(msgspec.msgpack.encode(result, enc_hook=encode_array)).hexdigest()
