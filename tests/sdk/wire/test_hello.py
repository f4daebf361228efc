"""What a worker may tell of itself: no more than every store can keep."""

import msgspec
import pytest

from eigenfail.errors import ProtocolError
from eigenfail.values.operations import LONGEST_NAME, MOST_VERSIONS
from eigenfail.wire.messages import (
    LARGEST_PID,
    PROTOCOL,
    Hello,
    encode,
    read_worker_message,
)

LONG = "w" * (LONGEST_NAME + 1)


@pytest.mark.parametrize(
    "told",
    [
        {"worker": LONG},
        {"host": LONG},
        {"pid": LARGEST_PID + 1},
        {"pid": 2**63},
        {"pid": -1},
        {"versions": {LONG: ""}},
        {"versions": {"numpy": LONG}},
        {"versions": {str(number): "" for number in range(MOST_VERSIONS + 1)}},
    ],
)
def test_what_no_store_could_keep_is_refused(told):
    hello = msgspec.structs.replace(Hello(PROTOCOL, "w", 8), **told)
    with pytest.raises(ProtocolError):
        read_worker_message(encode(hello))


def test_a_worker_that_names_no_bridge_has_none():
    assert read_worker_message(encode(Hello(PROTOCOL, "w", 8))).bridge is False
    assert read_worker_message(encode(Hello(PROTOCOL, "w", 8, bridge=True))).bridge is True


def test_the_longest_is_let_through():
    versions = {f"{number}": LONG[1:] for number in range(MOST_VERSIONS)}
    hello = Hello(PROTOCOL, LONG[1:], 8, LONG[1:], LARGEST_PID, versions=versions)
    assert read_worker_message(encode(hello)).versions == versions
