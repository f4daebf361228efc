"""The folder of all exports: what is known of each of them, from a folder of its own."""

import os
import shutil
import tempfile
from collections.abc import Collection
from contextlib import suppress
from hashlib import sha256
from pathlib import Path

import msgspec

from eigenfail.errors import NotFound, ServiceBusy
from eigenfail.values.export import Export, ExportState
from eigenfail_services.exports.files import (
    OURS_ALONE,
    close_to_others,
    measured,
    read,
    touched_s,
    write,
)

KEPT = 20
"""How many exports are kept; those that nobody fetched for longest make room."""

ASKED, WHOLE, BROKEN = "export.json", "episodes.parquet", "problem.txt"
SQLITE = "sqlite:///"


def folder_beside(database: str) -> Path:
    """Where the exports of a database belong: beside its file, or among temporary files."""
    if database.startswith(SQLITE):
        return Path(database.removeprefix(SQLITE)).absolute().parent / "exports"
    # Without user and password, which stand before the @.
    place = sha256(database.rpartition("@")[2].encode()).hexdigest()[:12]
    return Path(tempfile.gettempdir()) / f"eigenfail-exports-{os.getuid()}-{place}"


class Shelf:
    """Exports in a folder that nobody else can read; it is made when the first one comes.

    Every method raises ServiceError where the folder is somebody else's.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def home(self, export: str) -> Path:
        """The folder of one of them."""
        close_to_others(self._folder)
        return self._folder / export

    def add(self, export: Export) -> None:
        """Remember what was asked for."""
        self._folder.mkdir(parents=True, exist_ok=True, mode=OURS_ALONE)
        home = self.home(export.id)
        home.mkdir(mode=OURS_ALONE)
        write(home / ASKED, msgspec.json.encode(export))

    def look(self, export: str) -> Export:
        """What is known of it: it runs, as far as it has not come to an end.

        Raises:
            NotFound: it is not there.
        """
        home = self.home(export)
        if (asked := read(home / ASKED)) is None:
            raise NotFound(f"There is no export {export}.", f"The last {KEPT} are kept; ask anew.")
        known = msgspec.json.decode(asked, type=Export)
        if (ended := measured(home / WHOLE)) is not None:
            rows, size = ended
            return msgspec.structs.replace(
                known, state=ExportState.DONE, rows=rows, size_bytes=size
            )
        if (problem := read(home / BROKEN)) is not None:
            return msgspec.structs.replace(
                known, state=ExportState.FAILED, problem=problem.decode()
            )
        return known

    def fetch(self, export: str) -> Path:
        """The file of one that is done; it is the last one now to make room."""
        home = self.home(export)
        with suppress(FileNotFoundError):
            os.utime(home)
        return home / WHOLE

    def fail(self, export: str, problem: str) -> None:
        """Say why there is no file, unless nobody can ask for it any more."""
        with suppress(FileNotFoundError):
            write(self.home(export) / BROKEN, problem.encode())

    def make_room(self, busy: Collection[str]) -> None:
        """Leave room for one more; those at work stay.

        Raises:
            ServiceBusy: too many are at work.
        """
        if len(busy) >= KEPT:
            raise ServiceBusy(f"{KEPT} exports are at work already.", "Try again soon.")
        close_to_others(self._folder)
        if self._folder.exists():
            homes = [home for home in self._folder.iterdir() if home.name not in busy]
            for home in sorted(homes, key=touched_s)[: -(KEPT - 1)]:
                shutil.rmtree(home, ignore_errors=True)
