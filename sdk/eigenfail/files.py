"""Files that only their owner may read, and TOML files with errors that name the line."""

import os
import stat
import tomllib
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO, Any

from eigenfail.errors import InvalidValue, ServiceError

OWNER_ONLY = 0o600


FOLDER_MODE = 0o700


OTHERS = 0o007


def make_private_folder(folder: Path) -> None:
    """Make a folder, and those above it that are missing, for their owner alone.

    A folder that is there already keeps its permissions.

    Raises:
        OSError: it cannot be made.
    """
    if folder.is_dir():
        return
    if folder.parent != folder:
        make_private_folder(folder.parent)
    folder.mkdir(FOLDER_MODE, exist_ok=True)


def open_private(path: Path, mode: str) -> IO[bytes]:
    """Open a file to write bytes to it; one that is made is for its owner alone.

    A file that is there already keeps its permissions.

    Args:
        path: path of the file.
        mode: as `open` takes it, for bytes: ab, wb or xb.

    Raises:
        OSError: it cannot be opened.
    """
    return open(path, mode, opener=_open_for_owner)


def _open_for_owner(path: str, flags: int) -> int:
    return os.open(path, flags, OWNER_ONLY)


def write_whole(path: Path, chunks: Iterable[bytes]) -> None:
    """Write a file under a temporary name and move it into place once it is complete.

    Raises:
        ServiceError: it cannot be written.
    """
    part = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        try:
            with open_private(part, "wb") as file:
                file.writelines(chunks)
            part.replace(path)
        finally:
            with suppress(OSError):
                part.unlink(missing_ok=True)
    except OSError as error:
        problem = f"{path} cannot be written: {error.strerror or error}."
        raise ServiceError(problem, "Choose a file in a writable folder.") from error


def write_private(path: Path, text: str, field: str) -> None:
    """Make a file with one line that its owner alone can read; nothing is ever written over.

    Raises:
        InvalidValue: it is there already, or cannot be written.
    """
    with _written(path, field):
        descriptor = os.open(path, os.O_CREAT | os.O_EXCL | os.O_WRONLY, OWNER_ONLY)
        with os.fdopen(descriptor, "w") as file:
            file.write(f"{text}\n")


def write_new(path: Path, text: str, field: str) -> None:
    """Make a text file; nothing is ever written over.

    Raises:
        InvalidValue: it is there already, or cannot be written.
    """
    with _written(path, field), path.open("x", encoding="utf-8") as file:
        file.write(text)


def replace_private(path: Path, text: str, field: str) -> None:
    """The same, in the place of what may be there already: all of it or nothing.

    Raises:
        InvalidValue: it cannot be written.
    """
    draft = path.with_name(f".{path.name}.new")
    with _written(path, field):
        draft.unlink(missing_ok=True)
        write_private(draft, text, field)
        draft.replace(path)


@contextmanager
def _written(path: Path, field: str) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        problem = f"'{path}' cannot be written: {error.strerror}."
        raise InvalidValue(field, problem, "Choose another file, or remove this one.") from error


def read_private(path: Path, field: str) -> str:
    """The line in it.

    Raises:
        InvalidValue: it cannot be read, or every user of the machine can.
    """
    try:
        with path.open() as file:
            mode = stat.S_IMODE(os.fstat(file.fileno()).st_mode)
            text = file.read().strip()
    except (OSError, UnicodeDecodeError) as error:
        problem = f"'{path}' cannot be read: {getattr(error, 'strerror', 'it is not a text file')}."
        raise InvalidValue(field, problem, "Specify the file that contains the key.") from error
    if mode & OTHERS:
        problem = f"other users of this machine can access '{path}' (mode {mode:o})."
        raise InvalidValue(field, problem, f"Run: chmod 600 {path}; if others had it, revoke it.")
    return text


def read_toml(file: Path, like: str) -> dict[str, Any]:
    """The table in a file.

    Args:
        file: its path.
        like: what such a file should be: the remedy of every error.

    Raises:
        InvalidValue: it cannot be read, or is not TOML.
    """
    try:
        text = file.read_text(encoding="utf-8")
    except OSError as error:
        raise InvalidValue(str(file), f"cannot be read: {error.strerror}.", like) from error
    except ValueError as error:
        raise InvalidValue(str(file), f"is not TOML: {error}.", like) from error
    return parse_toml(text, str(file), like)


def parse_toml(text: str, field: str, like: str) -> dict[str, Any]:
    """Return the table in a text.

    Args:
        text: TOML.
        field: name of the text, for the error.
        like: what such a text should be: the remedy of the error.

    Raises:
        InvalidValue: it is not TOML.
    """
    try:
        return tomllib.loads(text)
    # tomllib gives up on deep nesting and on endless integers in errors of its own.
    except (ValueError, RecursionError) as error:
        raise InvalidValue(field, f"is not TOML: {error}.", like) from error
