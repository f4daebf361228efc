"""Finds one failing region: `eigenfail_services.campaigns.region` starts it and asks."""

import msgspec

from eigenfail import logs
from eigenfail.side_process import answer
from eigenfail_services.campaigns.region import RegionQuery, compute_region


def reply(question: bytes) -> bytes:
    """The region that was asked for."""
    return msgspec.msgpack.encode(
        compute_region(msgspec.msgpack.decode(question, type=RegionQuery))
    )


if __name__ == "__main__":
    logs.configure("services")
    answer(reply)
