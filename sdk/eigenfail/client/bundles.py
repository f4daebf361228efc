"""Bundles of files as a service sends them: unpacked within limits, or refused."""

import io
import lzma
import zipfile
import zlib
from collections.abc import Callable, Iterable, Iterator

from eigenfail.errors import ProtocolError

MOST_FILES = 10_000
MOST_BYTES = 1 << 28
"""Of all files together. A report of twenty campaigns with all pictures has some 10 MB."""

DAMAGED = (
    *(zipfile.BadZipFile, zlib.error, lzma.LZMAError, EOFError, OSError),
    *(RuntimeError, NotImplementedError, ValueError),  # encrypted, or packed in another way
)


def unpack(bundle: bytes, expected: Callable[[str], object]) -> dict[str, bytes]:
    """The files of a ZIP archive by name.

    Nothing is unpacked before all names are known to be expected, and never more than the limits
    say, whatever sizes the archive claims.

    Args:
        bundle: the archive.
        expected: whether a name may be in it.

    Raises:
        ProtocolError: it is damaged, has other files or one twice, too many, or too large ones.
    """
    try:
        with zipfile.ZipFile(io.BytesIO(bundle)) as packed:
            names = packed.namelist()
            check_names(names, expected)
            return dict(within_limit(packed, names))
    except DAMAGED as error:
        raise ProtocolError(f"The archive is damaged: {error}.", AGAIN) from error


def check_names(names: list[str], expected: Callable[[str], object]) -> None:
    """Raises ProtocolError for a name that would leave its folder, or that nobody expects."""
    if len(names) > MOST_FILES:
        raise ProtocolError(f"The archive has more than {MOST_FILES} files.", UNUSUAL)
    if len(set(names)) < len(names):
        raise ProtocolError("The archive has a file twice.", AGAIN)
    for name in names:
        if not expected(name):
            problem = f"The archive holds {name[:200]!r}, which is no file of a report."
            raise ProtocolError(problem, UNUSUAL)


def within_limit(packed: zipfile.ZipFile, names: Iterable[str]) -> Iterator[tuple[str, bytes]]:
    """The files one by one, as long as all together are within the limit."""
    left = MOST_BYTES
    for name in names:
        with packed.open(name) as file:
            content = file.read(left + 1)
        left -= len(content)
        if left < 0:
            size = f"{MOST_BYTES / 2**20:g} MiB"
            raise ProtocolError(f"The archive unpacks to more than {size}.", UNUSUAL)
        yield name, content


AGAIN = "Ask for it again; if it is so every time, use one version of eigenfail on both sides."
UNUSUAL = (
    "Nothing was written. Make sure that the address is that of an eigenfail service that you"
    " trust, of the same version."
)
