"""Reports, as a client sees them: fetched as one bundle, written as a whole or not at all."""

import io
import re
import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path
from tempfile import mkdtemp
from types import MappingProxyType
from zipfile import is_zipfile

import httpx2

from eigenfail.client.bundles import unpack
from eigenfail.client.link import Link
from eigenfail.errors import InvalidValue, ProtocolError, ServiceError
from eigenfail.values.report import Report
from eigenfail.wire.http import decode

DATA = "report.json"
FILE = re.compile(r"report\.(html|json)|(tables|pictures)/[a-z0-9-]+\.(csv|svg)")
ALSO = frozenset({"paper.md", "paper.json", "claims.json"})
"""Files that a reproduction of the paper adds to a report."""

WITHIN_S = 600.0
"""Twenty campaigns with all of their pictures take a while."""


NOTHING: Mapping[str, bytes] = MappingProxyType({})


def fetch_report(link: Link, campaigns: int | Sequence[int]) -> dict[str, bytes]:
    """The files of a report by name; raises as `Client.report` does."""
    ids = [campaigns] if isinstance(campaigns, int) else list(campaigns)
    asked = httpx2.QueryParams({"campaign": ids, "format": "zip"})
    return unpacked(link.get_bytes("/report", asked, WITHIN_S))


def write_report(
    files: Mapping[str, bytes], folder: Path, also: Mapping[str, bytes] = NOTHING
) -> Report:
    """Write a report and further files into a folder; raises as `Client.report` does."""
    report = decode(files[DATA], Report)
    try:
        write({**files, **also}, folder)
    except OSError as error:
        problem = f"The report cannot be written to {folder}: {error.strerror}."
        raise ServiceError(problem, "Name a folder that you may write.") from error
    return report


def check_folder(folder: Path, force: bool) -> None:
    """Refuse to lose what is there.

    Raises:
        InvalidValue: something is there that may not be overwritten.
    """
    if folder.is_dir() and not any(folder.iterdir()):
        return
    if folder.exists() and (alien := foreign(folder)):
        problem = f"{folder} is there already, and holds what no report does: {alien}."
        raise InvalidValue("output", problem, "Name a folder that is not there yet.")
    if folder.exists() and not force:
        problem = f"{folder} holds a report already."
        raise InvalidValue("output", problem, "Name another folder, or give --force.")


def foreign(folder: Path) -> str:
    """Something that is there and was not written by a report; empty if there is nothing."""
    if not folder.is_dir():
        return "it is no folder"
    files = (path for path in folder.rglob("*") if not path.is_dir())
    names = (path.relative_to(folder).as_posix() for path in files)
    return next((name for name in names if not (FILE.fullmatch(name) or name in ALSO)), "")


def unpacked(bundle: bytes) -> dict[str, bytes]:
    """The files of a bundle by name.

    Raises:
        ProtocolError: it is no bundle of a report, is damaged, or unpacks to more than any has.
    """
    if not is_zipfile(io.BytesIO(bundle)):
        raise not_a_report()
    files = unpack(bundle, FILE.fullmatch)
    if DATA not in files:
        raise not_a_report()
    return files


def not_a_report() -> ProtocolError:
    """The error of an answer that is something else."""
    return ProtocolError("The answer is no report.", "Use one version of eigenfail on both sides.")


def write(files: Mapping[str, bytes], folder: Path) -> None:
    """All files, or nothing: they are written elsewhere, and come in by one renaming.

    Raises:
        OSError: they cannot be written.
    """
    folder = folder.absolute()
    folder.parent.mkdir(parents=True, exist_ok=True)
    beside = Path(mkdtemp(prefix=f".{folder.name}-", dir=folder.parent))
    try:
        made, old = beside / "made", beside / "old"
        for name, content in files.items():
            (made / name).parent.mkdir(parents=True, exist_ok=True)
            (made / name).write_bytes(content)
        if folder.exists():
            folder.rename(old)
        try:
            made.rename(folder)
        except OSError:
            if old.exists():
                old.rename(folder)
            raise
    finally:
        shutil.rmtree(beside, ignore_errors=True)
