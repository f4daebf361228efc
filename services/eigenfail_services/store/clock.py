"""The wall clock, which labels rows and dates the leases of jobs."""

import time


def now_ms() -> int:
    """Milliseconds since 1970."""
    return time.time_ns() // 1_000_000


def until_ms(lease_s: float) -> int:
    """When a lease that begins now runs out."""
    return now_ms() + round(lease_s * 1_000)
