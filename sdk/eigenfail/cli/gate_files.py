"""The report that a gate writes for a pipeline."""

from contextlib import suppress
from pathlib import Path

from eigenfail.errors import InvalidValue


def check_folder(junit: Path | None) -> None:
    """Raises InvalidValue, before anything is run, if no report can be written there."""
    if junit and not junit.parent.is_dir():
        raise InvalidValue("junit", f"There is no folder {junit.parent}.", "Make it first.")


def write(file: Path, content: bytes) -> None:
    """All of it or nothing.

    Raises:
        InvalidValue: it cannot be written.
    """
    draft = file.with_name(f"{file.name}.new")
    try:
        draft.write_bytes(content)
        draft.replace(file)
    except OSError as error:
        with suppress(OSError):
            draft.unlink(missing_ok=True)
        problem = f"{file} cannot be written: {error.strerror}."
        raise InvalidValue("junit", problem, "Name a file in a folder of yours.") from error
