"""Parquet files made in the background, and how far they are.

The process that makes a file is the one that hands it out, so that no folder has to be shared.
Everything that counts is in that folder: an export whose process was killed is begun anew by the
next question about it.
"""

import threading
from pathlib import Path
from uuid import uuid4

import msgspec
import structlog

from eigenfail.contracts import Store
from eigenfail.errors import Conflict, StoreUnavailable
from eigenfail.values.export import Export, ExportRequest, ExportState
from eigenfail_services.exports.files import whole
from eigenfail_services.exports.parquet import require_pyarrow, write_parquet
from eigenfail_services.exports.selection import Source, selection_of
from eigenfail_services.exports.shelf import WHOLE, Shelf
from eigenfail_services.store.clock import now_ms

log = structlog.get_logger()


class ExportJobs:
    """Makes files one after the other, each in a folder of its own.

    Args:
        store: where the episodes are.
        folder: of all exports; made when the first one is asked for.
    """

    def __init__(self, store: Store, folder: Path) -> None:
        self._store = store
        self._shelf = Shelf(folder)
        self._rows: dict[str, int] = {}
        self._changing = threading.Lock()
        """Held from a look at the shelf to what is done because of it."""
        self._one_at_a_time = threading.Lock()

    def create(self, campaign: int, request: ExportRequest) -> Export:
        """Begin a file.

        Raises:
            NotFound: no such campaign.
            InvalidValue: a request that cannot be read, or no library to write it with.
            ServiceError: too many are at work already, or the folder is somebody else's.
        """
        selection_of(request)
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
        """How far it is; one that nobody works on any more is begun anew.

        Raises:
            NotFound: no such export.
            ServiceError: the folder is somebody else's.
        """
        with self._changing:
            return self._look(export)

    def file(self, export: str) -> Path:
        """The file, once it is whole.

        Raises:
            NotFound: no such export.
            Conflict: it is not done.
            ServiceError: the folder is somebody else's.
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
        except StoreUnavailable as error:  # the next question begins it anew
            log.warning("export interrupted", export=export.id, error=str(error))
        except Exception as error:
            log.exception("export failed", export=export.id)
            self._shelf.fail(export.id, f"{type(error).__name__}: {error}")
        finally:
            with self._changing:
                del self._rows[export.id]

    def _write(self, export: Export) -> None:
        def told(rows: int) -> None:
            self._rows[export.id] = rows

        source = Source(self._store, export.campaign, selection_of(export.request))
        with whole(self._shelf.home(export.id) / WHOLE) as part:
            write_parquet(part, source, told, noise=export.request.noise)
