"""Parquet exports, which are made in the background.

The process that makes a file also serves it, so that no folder has to be shared. The folder holds
the whole state: an export whose process was killed is started again by the next request for it.
"""

import threading
from pathlib import Path
from uuid import uuid4

import msgspec
import structlog

from eigenfail.error_text import describe_error
from eigenfail.errors import Conflict, StoreUnavailable
from eigenfail.values.export import Export, ExportRequest, ExportState
from eigenfail_services.exports.folder import EPISODES_FILE, ExportFolder, open_draft
from eigenfail_services.exports.formats import require_pyarrow, write_parquet
from eigenfail_services.exports.selection import ExportSource, parse_selection
from eigenfail_services.store import Store
from eigenfail_services.store.clock import now_ms

log = structlog.get_logger()


class ExportJobs:
    """Makes exports one after the other, each in a folder of its own.

    Args:
        store: of the episodes.
        folder: of all exports; it is created with the first one.
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
        parse_selection(request)
        require_pyarrow()
        self._store.campaigns.get(campaign)
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
                raise Conflict(problem, "Ask for its state until it is done.")
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
        except StoreUnavailable as error:  # the next request starts it again
            log.warning("export interrupted", export=export.id, error=str(error))
        except Exception as error:
            log.exception("export failed", export=export.id)
            self._shelf.fail(export.id, describe_error(error))
        finally:
            with self._changing:
                del self._rows[export.id]

    def _write(self, export: Export) -> None:
        def told(rows: int) -> None:
            self._rows[export.id] = rows

        source = ExportSource(self._store, export.campaign, parse_selection(export.request))
        with open_draft(self._shelf.home(export.id) / EPISODES_FILE) as part:
            write_parquet(part, source, told, noise=export.request.noise)
