"""Files that other processes may put there, and take away between two looks.

A file is opened once, and what is gone is not there.
"""

import os
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from uuid import uuid4

from eigenfail.errors import ServiceError

OURS_ALONE = 0o700
"""Permissions of a folder."""


def close_to_others(folder: Path) -> None:
    """Let nobody else into a folder, if it is there.

    Raises:
        ServiceError: it is not ours, so that others may have put things there, or a link.
    """
    try:
        seen = folder.lstat()
    except FileNotFoundError:
        return
    if not stat.S_ISDIR(seen.st_mode) or seen.st_uid != os.geteuid():
        problem = f"Exports cannot be kept in {folder}: it is a link, or belongs to somebody else."
        raise ServiceError(problem, "Remove it; the service makes a folder of its own.")
    if stat.S_IMODE(seen.st_mode) != OURS_ALONE:
        folder.chmod(OURS_ALONE)


def touched_s(path: Path) -> float:
    """When something was last put there; for ever ago where it is gone."""
    try:
        return path.stat().st_mtime
    except FileNotFoundError:
        return 0.0


def measured(path: Path) -> tuple[int, int] | None:
    """How many rows and bytes a Parquet file has; None if there is none."""
    from pyarrow.parquet import read_metadata

    try:
        with path.open("rb") as file:
            rows: int = read_metadata(file).num_rows
            return rows, os.fstat(file.fileno()).st_size
    except FileNotFoundError:
        return None


def read(path: Path) -> bytes | None:
    """The bytes of a file; None if there is none."""
    try:
        return path.read_bytes()
    except FileNotFoundError:
        return None


def write(path: Path, content: bytes) -> None:
    """A small file, whole or not at all."""
    with whole(path) as part:
        part.write_bytes(content)


@contextmanager
def whole(path: Path) -> Iterator[Path]:
    """Where to write a file that is at its path after the block, or not at all.

    Each writer has a place of its own: two processes may make the same file.
    """
    part = path.with_name(f"{path.name}.{uuid4().hex}.part")
    try:
        yield part
        part.replace(path)
    finally:
        part.unlink(missing_ok=True)
