"""What a process takes, and whether it takes ever more."""

from collections.abc import Sequence
from statistics import median
from typing import NamedTuple

import psutil

MOST_MORE_BYTES = 64 * 1024 * 1024
MOST_MORE_HANDLES = 16


class Sample(NamedTuple):
    """What a process takes at one time: resident memory, and open files and sockets."""

    resident_bytes: int
    handles: int


def sample(pid: int) -> Sample:
    """What a process takes now."""
    process = psutil.Process(pid)
    return Sample(process.memory_info().rss, process.num_fds())


def quarters(samples: Sequence[Sample]) -> tuple[Sample, Sample]:
    """What is typical of the first quarter of the time, and of the last one."""
    n = max(1, len(samples) // 4)
    return typical(samples[:n]), typical(samples[-n:])


def typical(samples: Sequence[Sample]) -> Sample:
    """The medians."""
    memory, handles = zip(*samples, strict=True)
    return Sample(int(median(memory)), int(median(handles)))


def growth(first: Sample, last: Sample) -> list[str]:
    """What has grown by more than it may."""
    found = []
    if last.resident_bytes > first.resident_bytes + MOST_MORE_BYTES:
        found.append(f"memory of the services grew: {first} to {last}")
    if last.handles > first.handles + MOST_MORE_HANDLES:
        found.append(f"open files of the services grew: {first} to {last}")
    return found


def told(samples: Sample) -> str:
    """In words."""
    return f"{samples.resident_bytes / 1e6:.0f} MB, {samples.handles} open files"
