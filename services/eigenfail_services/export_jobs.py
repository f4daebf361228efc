"""Parquet exports, which are made in the background, and their folder."""

import os
import shutil
import stat
import tempfile
import threading
from collections.abc import Collection, Iterator
from contextlib import contextmanager, suppress
from hashlib import sha256
from pathlib import Path
from uuid import uuid4

import msgspec
import structlog

from eigenfail import errors
from eigenfail.addresses import is_sqlite_url, sqlite_path
from eigenfail.files import make_private_folder, open_private
from eigenfail.values.export import Export, ExportRequest, ExportState
from eigenfail_services import export_formats
from eigenfail_services.store import Store
from eigenfail_services.store.clock import now_ms

PRIVATE_MODE = 0o700
"""Permissions of a folder that only its owner can use."""


def restrict_folder(folder: Path) -> None:
    """Make a folder private, if it exists.

    Raises:
        ServiceError: it is a link or belongs to another user, who may have put files there.
    """
    try:
        # `stat` would follow a link that another user has put there.
        seen = folder.lstat()
    except FileNotFoundError:
        return
    if not stat.S_ISDIR(seen.st_mode) or seen.st_uid != os.geteuid():
        problem = f"Exports cannot be kept in {folder}: it is a link, or belongs to another user."
        raise errors.ServiceError(problem, "Remove it; the service makes a folder of its own.")
    if stat.S_IMODE(seen.st_mode) != PRIVATE_MODE:
        folder.chmod(PRIVATE_MODE)


def _last_change_s(path: Path) -> float:
    """Return the time of a path's last change; 0 if it does not exist. [s since 1970]"""
    try:
        return path.stat().st_mtime
    except FileNotFoundError:
        return 0.0


def _measure_parquet(path: Path) -> tuple[int, int] | None:
    """Return the number of rows and bytes of a Parquet file; None if it does not exist."""
    from pyarrow.parquet import read_metadata

    try:
        with path.open("rb") as file:
            rows: int = read_metadata(file).num_rows
            return rows, os.fstat(file.fileno()).st_size
    except FileNotFoundError:
        return None


def _read_bytes(path: Path) -> bytes | None:
    """Return the bytes of a file; None if it does not exist."""
    try:
        return path.read_bytes()
    except FileNotFoundError:
        return None


def _write_bytes(path: Path, content: bytes) -> None:
    """Write a small file, completely or not at all."""
    with open_draft(path) as part:
        part.write_bytes(content)


@contextmanager
def open_draft(path: Path) -> Iterator[Path]:
    """Yield a draft that becomes the file of a path after the block, or is deleted on an error.

    Each writer has a draft of its own, as two processes may make the same file. The draft exists
    and is private already, and keeps its permissions when it is written to.
    """
    part = path.with_name(f"{path.name}.{uuid4().hex}.part")
    try:
        open_private(part, "xb").close()
        yield part
        part.replace(path)
    finally:
        part.unlink(missing_ok=True)


MAX_EXPORTS = 20
"""Number of exports that are kept; the ones that were not fetched for longest are deleted."""


REQUEST_FILE, EPISODES_FILE, PROBLEM_FILE = "export.json", "episodes.parquet", "problem.txt"


def find_export_folder(database: str) -> Path:
    """Return the export folder of a database: next to its file, or a temporary one."""
    if is_sqlite_url(database):
        return sqlite_path(database).parent / "exports"
    # Without user and password, which stand before the @.
    place = sha256(database.rpartition("@")[2].encode()).hexdigest()[:12]
    # The users of a machine share its temporary folder, so the name includes the user.
    return Path(tempfile.gettempdir()) / f"eigenfail-exports-{os.getuid()}-{place}"


class ExportFolder:
    """Exports in a private folder, which is created with the first export.

    Every method raises ServiceError if the folder belongs to another user.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def home(self, export: str) -> Path:
        """Return the folder of an export."""
        restrict_folder(self._folder)
        return self._folder / export

    def add(self, export: Export) -> None:
        """Create the folder of an export, with its request."""
        make_private_folder(self._folder)
        home = self.home(export.id)
        home.mkdir(mode=PRIVATE_MODE)
        _write_bytes(home / REQUEST_FILE, msgspec.json.encode(export))

    def look(self, export: str) -> Export:
        """Return the state of an export: running, unless its file or its problem is there.

        Raises:
            NotFound: the export does not exist.
        """
        home = self.home(export)
        if (asked := _read_bytes(home / REQUEST_FILE)) is None:
            raise errors.NotFound(
                f"Export {export} does not exist.",
                f"The last {MAX_EXPORTS} are kept; create a new export.",
            )
        known = msgspec.json.decode(asked, type=Export)
        # A complete file counts, whatever problem an earlier attempt has left behind.
        if (ended := _measure_parquet(home / EPISODES_FILE)) is not None:
            rows, size = ended
            return msgspec.structs.replace(
                known, state=ExportState.DONE, rows=rows, size_bytes=size
            )
        if (problem := _read_bytes(home / PROBLEM_FILE)) is not None:
            return msgspec.structs.replace(
                known, state=ExportState.FAILED, problem=problem.decode()
            )
        return known

    def fetch(self, export: str) -> Path:
        """Return the file of a finished export, which now will be deleted last."""
        home = self.home(export)
        with suppress(FileNotFoundError):
            os.utime(home)
        return home / EPISODES_FILE

    def fail(self, export: str, problem: str) -> None:
        """Write why an export failed, unless it was deleted meanwhile."""
        with suppress(FileNotFoundError):
            _write_bytes(self.home(export) / PROBLEM_FILE, problem.encode())

    def make_room(self, busy: Collection[str]) -> None:
        """Delete old exports, so that there is room for one more.

        Args:
            busy: exports that are running, which stay.

        Raises:
            ServiceBusy: too many exports are running.
        """
        if len(busy) >= MAX_EXPORTS:
            raise errors.ServiceBusy(
                f"{MAX_EXPORTS} exports are at work already.", "Try again soon."
            )
        restrict_folder(self._folder)
        if self._folder.exists():
            homes = [home for home in self._folder.iterdir() if home.name not in busy]
            surplus = max(0, len(homes) - (MAX_EXPORTS - 1 - len(busy)))
            for home in sorted(homes, key=_last_change_s)[:surplus]:
                shutil.rmtree(home, ignore_errors=True)


log = structlog.get_logger()


class ExportJobs:
    """Makes exports one after the other, each in a separate folder.

    Args:
        store: store of the episodes.
        folder: folder of all exports; it is created with the first one.
    """

    def __init__(self, store: Store, folder: Path) -> None:
        self._store = store
        self._shelf = ExportFolder(folder)
        self._rows: dict[str, int] = {}
        self._changing = threading.Lock()
        """Held from reading the folder's state to acting on it."""
        self._one_at_a_time = threading.Lock()

    def create(self, campaign: int, request: ExportRequest) -> Export:
        """Start an export.

        Raises:
            NotFound: the campaign does not exist.
            InvalidValue: the request is invalid, or pyarrow is not installed.
            ServiceError: too many exports are running, or the folder belongs to another user.
        """
        export_formats.make_export_source(self._store, campaign, request)
        export_formats.require_pyarrow()
        export = Export(
            id=uuid4().hex,
            campaign=campaign,
            request=request,
            state=ExportState.RUNNING,
            created_ms=now_ms(),
        )
        with self._changing:
            self._shelf.make_room(self._rows)
            self._shelf.add(export)
            self._begin(export)
        return export

    def get(self, export: str) -> Export:
        """Return the state of an export; an interrupted one is started again.

        Raises:
            NotFound: the export does not exist.
            ServiceError: the folder belongs to another user.
        """
        with self._changing:
            return self._look(export)

    def file(self, export: str) -> Path:
        """Return the file of a finished export.

        Raises:
            NotFound: the export does not exist.
            Conflict: it is not finished.
            ServiceError: the folder belongs to another user.
        """
        with self._changing:
            known = self._look(export)
            if known.state is not ExportState.DONE:
                problem = f"Export {export} is {known.state}, not done. {known.problem}".strip()
                raise errors.Conflict(problem, "Ask for its state until it is done.")
            return self._shelf.fetch(export)

    def _look(self, export: str) -> Export:
        known = self._shelf.look(export)
        if known.state is not ExportState.RUNNING:
            return known
        if export not in self._rows:
            self._begin(known)
        return msgspec.structs.replace(known, rows=self._rows[export])

    def _begin(self, export: Export) -> None:
        self._rows[export.id] = 0
        threading.Thread(target=self._run, args=(export,), daemon=True).start()

    def _run(self, export: Export) -> None:
        try:
            with self._one_at_a_time:
                self._write(export)
        except errors.StoreUnavailable as error:  # the next request starts it again
            log.warning("export interrupted", export=export.id, error=str(error))
        except Exception as error:
            log.exception("export failed", export=export.id)
            self._shelf.fail(export.id, errors.describe_error(error))
        finally:
            with self._changing:
                del self._rows[export.id]

    def _write(self, export: Export) -> None:
        def report_progress(rows: int) -> None:
            self._rows[export.id] = rows

        source = export_formats.make_export_source(self._store, export.campaign, export.request)
        with open_draft(self._shelf.home(export.id) / EPISODES_FILE) as part:
            export_formats.write_parquet(part, source, report_progress, noise=export.request.noise)
