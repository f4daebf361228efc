"""Clocks: wall time for rows, and a clock for leases that all services on a database share.

For PostgreSQL it is the server's clock. Users of a SQLite file are on one machine, and share its
monotonic clock, which counts from the start of the machine and cannot be set.
"""

import time
from typing import Any

from sqlalchemy import BigInteger
from sqlalchemy.ext.compiler import compiles
from sqlalchemy.sql.compiler import SQLCompiler
from sqlalchemy.sql.functions import GenericFunction


def now_ms() -> int:
    """Return the milliseconds since 1970."""
    return time.time_ns() // 1_000_000


def steady_ms() -> int:
    """Return the monotonic clock of the machine. [ms]"""
    return time.monotonic_ns() // 1_000_000


def length_ms(lease_s: float) -> int:
    """Return the length of a lease. [ms]"""
    return round(lease_s * 1_000)


class LeaseClock(GenericFunction[int]):
    """The clock of leases, in SQL; SQLite's connections call `steady_ms` by this name."""

    name = "lease_clock"
    type = BigInteger()
    inherit_cache = True


@compiles(LeaseClock, "postgresql")
def _servers_clock(_element: LeaseClock, _compiler: SQLCompiler, **_options: Any) -> str:
    # Not now(), which stands still while a transaction waits for a row.
    return "CAST(extract(epoch FROM clock_timestamp()) * 1000 AS BIGINT)"
