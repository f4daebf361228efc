"""Two clocks: the wall's labels rows; leases of jobs are dated by one that all share.

For PostgreSQL that is the server's own. Those who share a file are on one machine, and its steady
clock, which counts from the start of the machine and which nobody sets, is the same for them all.
"""

import time
from typing import Any

from sqlalchemy import BigInteger
from sqlalchemy.ext.compiler import compiles
from sqlalchemy.sql.compiler import SQLCompiler
from sqlalchemy.sql.functions import GenericFunction


def now_ms() -> int:
    """Milliseconds since 1970."""
    return time.time_ns() // 1_000_000


def steady_ms() -> int:
    """Milliseconds that only ever grow, until the machine is started anew."""
    return time.monotonic_ns() // 1_000_000


def length_ms(lease_s: float) -> int:
    """How long a lease is."""
    return round(lease_s * 1_000)


class LeaseClock(GenericFunction[int]):
    """What leases are dated by, in SQL; SQLite's connections know `steady_ms` by this name."""

    name = "lease_clock"
    type = BigInteger()
    inherit_cache = True


@compiles(LeaseClock, "postgresql")
def _servers_clock(_element: LeaseClock, _compiler: SQLCompiler, **_options: Any) -> str:
    # Not now(), which stands still while a transaction waits for a row.
    return "CAST(extract(epoch FROM clock_timestamp()) * 1000 AS BIGINT)"
