"""Reports that a service makes, written into a folder of this machine."""

import io
import lzma
import re
import zlib
from collections.abc import Sequence
from pathlib import Path
from zipfile import BadZipFile, ZipFile, is_zipfile

import httpx2

from eigenfail.client import Client
from eigenfail.client.references import CampaignsLike, find_campaign_ids
from eigenfail.errors import ProtocolError
from eigenfail.files import check_output_folder, write_folder
from eigenfail.wire.http import decode
from eigenfail_reports.contents import Report

DATA = "report.json"
FILE = re.compile(r"report\.(html|json)|(tables|pictures)/[a-z0-9-]+\.(csv|svg)")
"""Names of the files of a report: no other name is read, written or replaced."""

WITHIN_S = 600.0
"""Twenty campaigns with all of their pictures take a while."""

MAX_FILES = 10_000
MAX_BYTES = 1 << 28
"""Of all files together. A report of twenty campaigns with all pictures has some 10 MB."""

DAMAGED = (
    BadZipFile,
    zlib.error,
    lzma.LZMAError,
    EOFError,
    OSError,
    RuntimeError,
    NotImplementedError,
    ValueError,  # encrypted, or packed in another way
)
AGAIN = "Ask for it again; if it is so every time, use one version of eigenfail on both sides."
UNUSUAL = (
    "Nothing was written. Make sure that the address is that of an eigenfail service that you"
    " trust, of the same version."
)


def write_report(
    client: Client, campaigns: CampaignsLike, folder: Path | str, *, force: bool = False
) -> Report:
    """Write a report on campaigns into a folder: report.html with its data files.

    The folder gets the whole report or stays unchanged.

    Args:
        client: client of the service that has the campaigns; the plug-in is installed there, too.
        campaigns: one, or several in the order of the report.
        folder: folder that is not there yet, or is empty.
        force: replace the report that is in the folder.

    Raises:
        NotFound: no such campaign, or a service without the plug-in.
        InvalidValue: no campaign, too many, one that is named twice, or a folder that would be
            overwritten.
        ServiceError: the folder cannot be written.
    """
    folder = Path(folder)
    # First, since the service may take minutes to make a report that could not be written.
    check_output_folder(folder, "report", FILE, force=force)
    ids = find_campaign_ids(campaigns)
    asked = httpx2.QueryParams({"campaign": list(ids), "format": "zip"})
    files = unpack(client.link.get_bytes("/report", asked, WITHIN_S))
    report = decode(files[DATA], Report)
    write_folder(files, folder)
    return report


def unpack(bundle: bytes) -> dict[str, bytes]:
    """Return the files of a report by name, from the ZIP archive that a service sent.

    Names and sizes are looked at before anything is unpacked. An archive that claims too little is
    not read beyond its claim, and is damaged by its checksum.

    Raises:
        ProtocolError: the archive is not a report, is damaged, or holds other or larger files.
    """
    if not is_zipfile(io.BytesIO(bundle)):
        raise _not_a_report()
    try:
        with ZipFile(io.BytesIO(bundle)) as archive:
            names = archive.namelist()
            _check_names(names)
            if sum(entry.file_size for entry in archive.infolist()) > MAX_BYTES:
                size = f"{MAX_BYTES / 2**20:g} MiB"
                raise ProtocolError(f"The archive unpacks to more than {size}.", UNUSUAL)
            files = {name: archive.read(name) for name in names}
    except DAMAGED as error:
        raise ProtocolError(f"The archive is damaged: {error}.", AGAIN) from error
    if DATA not in files:
        raise _not_a_report()
    return files


def _check_names(names: Sequence[str]) -> None:
    if len(names) > MAX_FILES:
        raise ProtocolError(f"The archive has more than {MAX_FILES} files.", UNUSUAL)
    if len(set(names)) < len(names):
        raise ProtocolError("The archive contains a duplicate file.", AGAIN)
    for name in names:
        if not FILE.fullmatch(name):
            problem = f"The archive holds {name[:200]!r}, which is not part of a report."
            raise ProtocolError(problem, UNUSUAL)


def _not_a_report() -> ProtocolError:
    return ProtocolError("The response is not a report.", "Use one release on both sides.")
