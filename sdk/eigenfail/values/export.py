"""Exports of episodes: as what they are written, and how far a Parquet file is."""

from enum import StrEnum

import msgspec


class ExportFormat(StrEnum):
    """As what episodes are written. Text is streamed; `parquet` is made first, then fetched."""

    CSV = "csv"
    NDJSON = "ndjson"
    PARQUET = "parquet"


class ExportRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Contents of an export; see docs/episodes.md.

    Attributes:
        filter: conditions on its episodes.
        sort: their order.
        fields: columns; all of them if none is named.
        noise: whether each episode's z comes along, as `<channel>_z`: on a road `longitudinal_z`
            and `lateral_z`. [sigma]
    """

    filter: str = ""
    sort: str = "index"
    fields: tuple[str, ...] = ()
    noise: bool = False


class ExportState(StrEnum):
    """Progress of an export."""

    RUNNING = "running"
    DONE = "done"
    FAILED = "failed"


class Export(msgspec.Struct, frozen=True, kw_only=True):
    """A Parquet file of episodes.

    Attributes:
        id: identifier of the export.
        rows: how many episodes are written so far.
        size_bytes: size of the file; None until it is done.
        problem: why it failed; empty unless it did.
    """

    id: str
    campaign: int
    request: ExportRequest
    state: ExportState
    created_ms: int
    rows: int = 0
    size_bytes: int | None = None
    problem: str = ""
