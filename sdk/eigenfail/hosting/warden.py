"""The warden: a process that outlives whoever started a service, and then ends what is left of it.

It waits for the end of its standard input. The system closes that however its other end dies: by a
signal that nobody can catch, or with the kernel of a notebook.
"""

import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from eigenfail.hosting.processes import OWNER_MARK, kill_marked

ALL_WELL = b"all is well\n"
REMOVE = "--remove"


@contextmanager
def guard_owner(owner: str) -> Iterator[None]:
    """Have the owner's processes ended if this process dies within the block."""
    with _guarding([owner]):
        yield


@contextmanager
def remove_afterwards(folder: Path) -> Iterator[None]:
    """Have a folder of ours, and the processes that run on it, gone after the block in any case."""
    with _guarding([str(folder), REMOVE]):
        try:
            yield
        finally:
            shutil.rmtree(folder, ignore_errors=True)


@contextmanager
def _guarding(words: list[str]) -> Iterator[None]:
    """A warden for as long as the block lasts."""
    unmarked = {name: text for name, text in os.environ.items() if name != OWNER_MARK}
    process = subprocess.Popen(
        [sys.executable, "-m", __name__, *words],
        stdin=subprocess.PIPE,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        env=unmarked,
        start_new_session=True,
    )
    try:
        yield
    finally:
        process.communicate(ALL_WELL)


def main() -> None:
    """Wait for the end; unless all is well, put things in order."""
    if sys.stdin.buffer.read() == ALL_WELL:
        return
    owner = sys.argv[1]
    kill_marked(owner)
    if REMOVE in sys.argv[2:]:
        shutil.rmtree(owner, ignore_errors=True)


if __name__ == "__main__":
    main()
