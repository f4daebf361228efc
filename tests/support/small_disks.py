"""File systems of a test's own with little room."""

import subprocess
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import pytest

BLOCK = b"\0" * 65_536


@contextmanager
def mount_small_disk(folder: Path, size: str) -> Iterator[None]:
    """Mount one on an empty folder for as long as the block lasts; without the right to, skip."""
    command = ["mount", "-t", "tmpfs", "-o", f"size={size},mode=0755", "tmpfs", str(folder)]
    try:
        subprocess.run(command, check=True, capture_output=True)
    except (OSError, subprocess.CalledProcessError):
        pytest.skip("no file system can be mounted here")
    try:
        yield
    finally:  # lazily: who was killed may hold a file of it open for a moment
        subprocess.run(["umount", "--lazy", str(folder)], check=True)


def fill(file: Path) -> None:
    """Take all the room that is left, to the last byte."""
    with file.open("ab", buffering=0) as stream:
        for block in (BLOCK, BLOCK[:4096], b"\0"):
            with suppress(OSError):
                while stream.write(block):
                    pass
