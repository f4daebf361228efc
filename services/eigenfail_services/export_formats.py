"""Episodes of a campaign as NDJSON, CSV and Parquet.

All formats are generated while they are sent. The metadata of a Parquet file names the origin of
its episodes.
"""

import csv
import io
import re
from collections.abc import Iterator
from hashlib import sha256
from importlib.util import find_spec
from typing import Any, NamedTuple

import msgspec

from eigenfail import __version__, filters
from eigenfail.errors import InvalidValue
from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail.values.records import PORTION, EpisodeRow
from eigenfail.worlds import list_channels
from eigenfail_services.store.store import Store

Cells = list[filters.Value | None]


class Selection(msgspec.Struct, frozen=True):
    """The chosen episodes, their order, and their columns.

    Columns are names that `find_column` accepts.
    """

    where: filters.Conditions
    sort: filters.SortOrder
    columns: tuple[str, ...]


class ExportSource(NamedTuple):
    """The episodes of a campaign that are wanted."""

    store: Store
    campaign: int
    wanted: Selection


def _describe(columns: tuple[str, ...]) -> list[filters.Column]:
    return [filters.find_column(name, "fields") for name in columns]


def read_batches(source: ExportSource) -> Iterator[tuple[EpisodeRow, ...]]:
    """Yield the episodes in their order, 1 to `PORTION` at a time."""
    store, campaign, wanted = source
    after: int | None = None
    while True:
        # Each page is a transaction of its own, so none stays open for as long as a client reads.
        page = store.episodes.page(campaign, PORTION, after, wanted.where, wanted.sort)
        if page.items:
            yield page.items
        if page.next is None:
            return
        after = page.next


def read_cells(row: EpisodeRow, columns: tuple[str, ...]) -> Cells:
    """Return the values of a row in some columns."""
    return [filters.read_value(row, column) for column in columns]


def pick_columns(row: EpisodeRow, columns: tuple[str, ...]) -> dict[str, filters.Value | None]:
    """Return the values of a row in some columns, by the name of the column."""
    return dict(zip(columns, read_cells(row, columns), strict=True))


FORMULA = ("=", "+", "-", "@", "\t", "\r")
"""Beginnings of texts that a spreadsheet would compute as formulas."""


def write_ndjson(source: ExportSource) -> Iterator[bytes]:
    """Yield lines with one JSON object each, some lines at a time."""
    columns = source.wanted.columns
    encoder = msgspec.json.Encoder()
    for rows in read_batches(source):
        yield encoder.encode_lines([pick_columns(row, columns) for row in rows])


def write_csv(source: ExportSource) -> Iterator[bytes]:
    """Yield a header, then one line for each episode; missing values are empty."""
    columns = source.wanted.columns
    texts = [each.kind is filters.ColumnKind.TEXT for each in _describe(columns)]
    yield _encode_lines([list(columns)])
    for rows in read_batches(source):
        found = (zip(read_cells(row, columns), texts, strict=True) for row in rows)
        yield _encode_lines(
            [[_format_cell(value, is_text) for value, is_text in line] for line in found]
        )


def _format_cell(value: filters.Value | None, is_text: bool) -> str:
    """Return a value as the text of a cell; a text is never a formula."""
    if value is None:
        return ""
    if isinstance(value, bool):
        return str(value).lower()
    words = str(value)
    # A number may begin with a minus sign, and must remain a number.
    return f"'{words}" if is_text and words.startswith(FORMULA) else words


def _encode_lines(lines: list[list[str]]) -> bytes:
    """Return some lines of a table as bytes of CSV."""
    text = io.StringIO()
    csv.writer(text).writerows(lines)
    return text.getvalue().encode()


def name_noise_columns(spec: CampaignSpec) -> tuple[str, ...]:
    """Return the columns of a campaign's noise: a list of float32 for each episode. [sigma]"""
    return tuple(f"{channel}_z" for channel in list_channels(spec))


UNIT = re.compile(r"\[([^]]+)\]$")


class ExportOrigin(msgspec.Struct, frozen=True):
    """The origin of a file's episodes, for its metadata.

    Attributes:
        campaign: id of its campaign.
        spec_sha256: SHA-256 of the campaign's spec, see `_hash_spec`.
        eigenfail: version that wrote it.
        units: units of the columns that have one.
    """

    campaign: int
    spec_sha256: str
    eigenfail: str
    units: dict[str, str]


def _describe_origin(
    source: ExportSource, spec: CampaignSpec, noise: tuple[str, ...]
) -> ExportOrigin:
    """Return the metadata of a file: the origin of its episodes."""
    units = _find_units(source.wanted.columns) | dict.fromkeys(noise, "sigma")
    return ExportOrigin(source.campaign, _hash_spec(spec), __version__, units)


def _hash_spec(spec: CampaignSpec) -> str:
    """Return the SHA-256 of a spec as compact JSON with sorted keys: equal for equal specs."""
    return sha256(msgspec.json.encode(spec, order="sorted")).hexdigest()


def _find_units(columns: tuple[str, ...]) -> dict[str, str]:
    """Return the units of columns by name: their descriptions end with the unit."""
    found = {each.name: UNIT.search(each.words) for each in _describe(columns)}
    return {name: unit[1] for name, unit in found.items() if unit}


KEYS = ("eigenfail", "PANDAS_ATTRS")
"""Keys of a file's metadata, in JSON: eigenfail's own, and the one that pandas reads as `attrs`."""


def has_pyarrow() -> bool:
    """Return whether the Parquet library, which comes with an extra, is installed."""
    return find_spec("pyarrow") is not None


def require_pyarrow() -> None:
    """Raise InvalidValue if the library of Parquet is not installed."""
    if not has_pyarrow():
        raise InvalidValue(
            "format",
            "Parquet needs pyarrow, which is not installed where the service runs.",
            "Run there, in a clone: pip install '.[export]'; csv and ndjson need nothing.",
        )


def write_parquet(source: ExportSource, *, noise: bool) -> Iterator[bytes]:
    """Yield a Parquet file, a row group at a time.

    Args:
        source: the episodes and their columns.
        noise: whether their z is included.

    Raises:
        NotFound: no such campaign.
    """
    # pyarrow is an extra, which a service without Parquet exports does not need.
    from pyarrow import table
    from pyarrow.parquet import ParquetWriter

    columns, spec = source.wanted.columns, source.store.campaigns.get(source.campaign).spec
    channels = name_noise_columns(spec) if noise else ()
    schema = _make_schema(columns, channels, _describe_origin(source, spec, channels))
    # A Parquet file is written from its beginning to its end, and what describes it comes last: so
    # it can be sent while it is written, and no copy of it is kept here.
    written = io.BytesIO()
    with ParquetWriter(
        written, schema, compression="zstd", **_choose_encodings(columns, channels)
    ) as writer:
        for rows in read_batches(source):
            filled = {name: [filters.read_value(row, name) for row in rows] for name in columns}
            filled |= _read_noise(source, rows, channels) if channels else {}
            writer.write_table(table(filled, schema=schema))
            yield written.getvalue()
            written.seek(0)
            written.truncate()
    yield written.getvalue()


def _choose_encodings(columns: tuple[str, ...], noise: tuple[str, ...]) -> dict[str, list[str]]:
    """Return the encodings: a dictionary for texts, and floats split into their bytes."""
    # Numbers that all differ would fill a dictionary in vain; split into their bytes they take less
    # space and are read faster.
    described = _describe(columns)
    of = {
        kind: [each.name for each in described if each.kind is kind] for kind in filters.ColumnKind
    }
    inside_lists = [f"{name}.list.element" for name in noise]
    return {
        "use_dictionary": of[filters.ColumnKind.TEXT],
        "use_byte_stream_split": of[filters.ColumnKind.NUMBER] + inside_lists,
    }


def _make_schema(columns: tuple[str, ...], noise: tuple[str, ...], origin: ExportOrigin) -> Any:
    """Return the schema: types and descriptions of columns, and the origin of the file."""
    import pyarrow as pa

    types = {
        filters.ColumnKind.NUMBER: pa.float64(),
        filters.ColumnKind.WHOLE: pa.int64(),
        filters.ColumnKind.TEXT: pa.string(),
        filters.ColumnKind.FLAG: pa.bool_(),
    }
    fields = [
        pa.field(each.name, types[each.kind], metadata={"words": each.words})
        for each in _describe(columns)
    ]
    each = pa.list_(pa.field("element", pa.float32()))
    fields += [pa.field(name, each, metadata={"words": "z_t [sigma]"}) for name in noise]
    said = msgspec.json.encode(origin)
    return pa.schema(fields, metadata=dict.fromkeys(KEYS, said))


def _read_noise(
    source: ExportSource, rows: tuple[EpisodeRow, ...], names: tuple[str, ...]
) -> dict[str, list[Any]]:
    """Return the noise of some rows by channel; None for a row whose noise was pruned."""
    there = [row.index for row in rows if row.noise_pruned_ms is None]
    results = source.store.episodes.finished(source.campaign, there)
    # Transposed once: a column of the file is one channel of all steps.
    noise = {result.index: result.noise.z.T for result in results}
    return {
        name: [noise[row.index][number] if row.index in noise else None for row in rows]
        for number, name in enumerate(names)
    }
