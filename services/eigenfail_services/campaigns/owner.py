"""Who holds a job: a process by a name that no other one ever has, so that its death can be seen.

Only of a process on this machine, as this one sees it, can anybody say that it is dead: of others,
the lease alone says so.
"""

import os
import platform
from pathlib import Path
from typing import NamedTuple
from uuid import uuid4

import psutil

PROCESSES = Path("/proc")
ZOMBIE = "Z"
NOWHERE = uuid4().hex


class Life(NamedTuple):
    """A process as the kernel tells of it: its state, and when it started after the machine did."""

    state: str
    started: str


def this_process() -> str:
    """The name of the owner that we are."""
    life = life_of(os.getpid())
    return f"{place()}:{os.getpid()}:{life.started if life else ''}"


def is_lost(owner: str) -> bool:
    """Whether it was a process here, and is no more."""
    where, _, rest = owner.partition(":")
    pid, _, started = rest.partition(":")
    if where != place() or not (pid.isdecimal() and started):
        return False
    life = life_of(int(pid))
    if life is None:  # it may only be hidden from us
        return not psutil.pid_exists(int(pid))
    return life.state == ZOMBIE or life.started != started


def place() -> str:
    """The machine since its last start, and the space in which its processes are counted.

    Two containers may have one name; a restarted machine counts its processes anew. Where the
    kernel does not tell, it is nowhere else: this process alone is there.
    """
    try:
        boot = (PROCESSES / "sys/kernel/random/boot_id").read_text("utf-8").strip()
        space = (PROCESSES / "self/ns/pid").stat().st_ino
    except OSError:
        return f"{platform.node()}/{NOWHERE}".replace(":", "_")
    return f"{platform.node()}/{boot}/{space}".replace(":", "_")


def life_of(pid: int) -> Life | None:
    """What is known of a process; None if there is none."""
    try:
        text = (PROCESSES / str(pid) / "stat").read_text("utf-8", "replace")
    except OSError:
        return None
    # The name of the program is in brackets, and may hold spaces and brackets of its own.
    fields = text.rpartition(")")[2].split()
    return Life(fields[0], fields[19])
