"""Files of episodes: streamed, or made by the service and then fetched."""

import os
from collections.abc import Callable, Iterator
from contextlib import suppress
from functools import partial
from pathlib import Path

from eigenfail.client.link import Link
from eigenfail.client.waiting import wait_until
from eigenfail.errors import InvalidValue, ServiceError, UnknownName
from eigenfail.values.export import Export, ExportFormat, ExportRequest, ExportState

POLL_S = 0.5


class Exports:
    """Has files made, and fetches them."""

    def __init__(self, link: Link) -> None:
        self._link = link
        self._writers: dict[ExportFormat, Callable[[int, ExportRequest], Iterator[bytes]]] = {
            ExportFormat.CSV: partial(self._streamed, ".csv"),
            ExportFormat.NDJSON: partial(self._streamed, ".ndjson"),
            ExportFormat.PARQUET: self._made,
        }

    def save(
        self, campaign: int, request: ExportRequest, path: Path, form: ExportFormat | str | None
    ) -> Path:
        """Write a file, all of it or nothing."""
        chosen = format_of(path, form)
        if request.noise and chosen is not ExportFormat.PARQUET:
            raise InvalidValue("noise", f"{chosen} holds no noise.", "Ask for parquet.")
        write_whole(path, self._writers[chosen](campaign, request))
        return path

    def _streamed(self, suffix: str, campaign: int, request: ExportRequest) -> Iterator[bytes]:
        asked = {
            "filter": request.filter or None,
            "sort": request.sort,
            "fields": ",".join(request.fields) or None,
        }
        return self._link.chunks(f"/campaigns/{campaign}/episodes{suffix}", asked)

    def _made(self, campaign: int, request: ExportRequest) -> Iterator[bytes]:
        asked = self._link.post(f"/campaigns/{campaign}/exports", Export, request)
        place = f"/exports/{asked.id}"
        made = wait_until(lambda: self._link.get(place, Export), is_over, POLL_S, None)
        if made.state is ExportState.FAILED:
            raise ServiceError(f"Export {made.id} failed: {made.problem}")
        return self._link.chunks(f"{place}/file", {})


def is_over(export: Export) -> bool:
    """Whether nobody works on it any more."""
    return export.state is not ExportState.RUNNING


def format_of(path: Path, form: ExportFormat | str | None) -> ExportFormat:
    """The format that was asked for, or that a file's name ends in.

    Raises:
        UnknownName: there is no such format.
    """
    name = form or path.suffix.removeprefix(".").lower()
    if name not in list(ExportFormat):
        raise UnknownName("format", name, ExportFormat)
    return ExportFormat(name)


def write_whole(path: Path, chunks: Iterator[bytes]) -> None:
    """Write a file beside its place and move it there once it is whole.

    Raises:
        ServiceError: it cannot be written.
    """
    part = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        try:
            with part.open("wb") as file:
                file.writelines(chunks)
            part.replace(path)
        finally:
            with suppress(OSError):
                part.unlink(missing_ok=True)
    except OSError as error:
        problem = f"{path} cannot be written: {error.strerror or error}."
        raise ServiceError(problem, "Name a file in a folder that can be written.") from error
