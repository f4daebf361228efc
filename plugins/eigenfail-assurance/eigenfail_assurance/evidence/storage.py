"""Bundles on a disk, as folders or ZIP archives: written whole or not at all, read with limits.

Archives are not unpacked to the disk. Only names of files that a bundle has are read, so that no
name leads out of it, and links are refused.
"""

import io
import re
import zipfile
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import msgspec

from eigenfail.errors import InvalidValue, ServiceError
from eigenfail.files import replace_whole
from eigenfail_assurance.evidence.bundle import LARGEST_FILE, MANIFEST

NAME = re.compile(
    r"(?:question|inputs|argument)\.json|argument\.svg|report\.html|solutions/Sn[1-9][0-9]{0,5}\.json"
    r"|campaigns/[1-9][0-9]{0,18}\.(?:json|episodes\.csv|noise\.json)"
)
"""Names of files besides the manifest: no other name is read or written."""

LARGEST_BUNDLE, MOST_FILES = 2**30, 5_000
"""Size of a bundle, and the number of its files, that are read at most. [bytes]"""

LONG_AGO = (1980, 1, 1, 0, 0, 0)
"""Time of the files in a ZIP archive, so that the same files make the same archive."""


class BundleDefect(msgspec.Struct, frozen=True, kw_only=True):
    """A difference between a bundle and its original.

    Attributes:
        where: the file, and the field in it.
        problem: description of the defect.
    """

    where: str
    problem: str


def make_defect(error: InvalidValue) -> BundleDefect:
    """Return the defect that an error about a file of a bundle describes."""
    problem = error.problem.removeprefix(f"{error.field}: ")
    return BundleDefect(where=error.field, problem=f"{problem[:1].upper()}{problem[1:]}")


class StoredBundle(NamedTuple):
    """The files of a bundle by name, and what could not be read."""

    files: dict[str, bytes]
    defects: tuple[BundleDefect, ...]


DAMAGED = (zipfile.BadZipFile, zlib.error, EOFError, NotImplementedError, RuntimeError, ValueError)

ANOTHER = "Choose another folder, or give --force to replace it."


def check_output(output: Path, *, force: bool) -> None:
    """Refuse a path that holds anything but a bundle, or a bundle that must not be replaced.

    Raises:
        InvalidValue: a bundle cannot be written there.
    """
    if not output.exists() or (output.is_dir() and not any(output.iterdir())):
        return
    if foreign := _find_foreign(output):
        problem = f"'{output}' exists, and {foreign}."
        raise InvalidValue("--output", problem, "Choose another folder.")
    if not force:
        raise InvalidValue("--output", f"'{output}' already holds a bundle.", ANOTHER)


def _find_foreign(output: Path) -> str:
    """Return why a path is not a bundle; empty if it is one."""
    if output.is_dir():
        files = (each for each in output.rglob("*") if each.is_symlink() or not each.is_dir())
        names = [each.relative_to(output).as_posix() for each in files]
        strange = next(
            (each for each in names if each != MANIFEST and not NAME.fullmatch(each)), ""
        )
        if strange:
            return f"holds a file of no bundle: {strange}"
        return "" if MANIFEST in names else f"holds no {MANIFEST}"
    return "" if output.suffix == ".zip" and zipfile.is_zipfile(output) else "is no bundle"


def write_bundle(files: Mapping[str, bytes], output: Path) -> None:
    """Write a bundle to a folder, or to an archive if the name ends with .zip: all or nothing.

    Raises:
        ServiceError: it cannot be written.
    """
    try:
        with replace_whole(output) as made:
            if output.suffix == ".zip":
                made.write_bytes(pack_bundle(files))
                return
            for name, content in files.items():
                (made / name).parent.mkdir(parents=True, exist_ok=True)
                (made / name).write_bytes(content)
    except OSError as error:
        problem = f"The bundle cannot be written to {output.absolute()}: {error.strerror or error}."
        raise ServiceError(problem, "Choose a folder that you can write to.") from error


def pack_bundle(files: Mapping[str, bytes]) -> bytes:
    """Return a ZIP archive of files: the same bytes for the same files."""
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in files.items():
            archive.writestr(zipfile.ZipInfo(name, LONG_AGO), content, zipfile.ZIP_DEFLATED)
    return packed.getvalue()


def read_bundle(path: Path) -> StoredBundle:
    """Return the files of a bundle; files of other names, too large ones and links are defects.

    Raises:
        InvalidValue: the path does not exist, cannot be read, or is a device or a pipe.
    """
    try:
        if path.is_dir():
            return _read_folder(path)
        if path.is_file():
            return _read_archive(path)
    except OSError as error:
        problem = f"'{path}' cannot be read: {error.strerror or error}."
        raise InvalidValue("bundle", problem) from error
    problem = f"'{path}' does not exist."
    if path.exists():
        problem = f"'{path}' is a device or a pipe, and not a regular file."
    raise InvalidValue("bundle", problem, "Name a folder or a ZIP archive.")


def _read_folder(folder: Path) -> StoredBundle:
    if not (folder / MANIFEST).is_file():
        raise InvalidValue("bundle", f"'{folder}' holds no {MANIFEST}.", "Name a bundle.")
    paths = [each for each in sorted(folder.rglob("*")) if each.is_symlink() or not each.is_dir()]
    regular = [each for each in paths if not each.is_symlink() and each.is_file()]
    sizes = {each.relative_to(folder).as_posix(): each.stat().st_size for each in regular}
    defects = [
        BundleDefect(where=each.relative_to(folder).as_posix(), problem="It is no regular file.")
        for each in paths
        if each not in regular
    ]
    defects += _check_sizes(sizes)
    if defects:
        return StoredBundle({}, tuple(defects))
    return StoredBundle({name: (folder / name).read_bytes() for name in sizes}, ())


def _read_archive(path: Path) -> StoredBundle:
    if not zipfile.is_zipfile(path):
        raise InvalidValue("bundle", f"'{path}' is no ZIP archive.", "Name a bundle.")
    try:
        with zipfile.ZipFile(path) as archive:
            entries = archive.infolist()
            sizes = {each.filename: each.file_size for each in entries}
            defects = _check_sizes(sizes)
            if len(sizes) < len(entries):
                defects.append(BundleDefect(where=path.name, problem="It holds a file twice."))
            if defects:
                return StoredBundle({}, tuple(defects))
            # Reading stops at the size that an entry claims, which was looked at.
            return StoredBundle({name: archive.read(name) for name in sizes}, ())
    except DAMAGED as error:
        defect = BundleDefect(where=path.name, problem=f"The archive is damaged: {error}.")
        return StoredBundle({}, (defect,))


def _check_sizes(sizes: Mapping[str, int]) -> list[BundleDefect]:
    """Return what must not be read, by name and size."""
    if len(sizes) > MOST_FILES or sum(sizes.values()) > LARGEST_BUNDLE:
        limit = f"{MOST_FILES} files of {LARGEST_BUNDLE // 2**20} MiB in all"
        return [BundleDefect(where=MANIFEST, problem=f"The bundle is larger than {limit}.")]
    strange = [each for each in sizes if each != MANIFEST and not NAME.fullmatch(each)]
    large = [name for name, size in sizes.items() if size > LARGEST_FILE]
    limit = f"{LARGEST_FILE // 2**20} MiB"
    return [
        *(BundleDefect(where=each[:200], problem="It is no file of a bundle.") for each in strange),
        *(BundleDefect(where=each[:200], problem=f"It is larger than {limit}.") for each in large),
    ]
