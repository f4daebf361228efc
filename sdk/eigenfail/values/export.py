"""Exports of episodes: as what they are written, and which of them."""

from enum import StrEnum

import msgspec


class ExportFormat(StrEnum):
    """As what episodes are written."""

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
