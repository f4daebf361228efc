"""Episodes as Parquet: small, typed, read column by column."""

from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import msgspec

from eigenfail.errors import InvalidValue
from eigenfail.filters import COLUMNS, Kind, value_of
from eigenfail.values.records import EpisodeRow
from eigenfail_services.exports.origin import NOISE, Origin, origin_of
from eigenfail_services.exports.selection import Source, portions

KEYS = ("eigenfail", "PANDAS_ATTRS")
"""Where a file tells of itself, in JSON: for everybody, and where pandas looks for `attrs`."""


def require_pyarrow() -> None:
    """Refuse to begin without the library, which comes with an extra.

    Raises:
        InvalidValue: it is not installed.
    """
    if find_spec("pyarrow") is None:
        raise InvalidValue(
            "format",
            "Parquet needs pyarrow, which is not installed where the service runs.",
            "Run there: pip install 'eigenfail[export]'; csv and ndjson need nothing.",
        )


def write_parquet(path: Path, source: Source, told: Callable[[int], None], *, noise: bool) -> None:
    """Write a file.

    Args:
        path: where to.
        source: the episodes, and which columns of them.
        told: called with the number of rows written so far.
        noise: whether their z comes along.
    """
    from pyarrow import table
    from pyarrow.parquet import ParquetWriter

    columns = source.wanted.columns
    schema = schema_of(columns, origin_of(source, noise=noise), noise=noise)
    done = 0
    with ParquetWriter(
        path, schema, compression="zstd", **encodings(columns, noise=noise)
    ) as writer:
        for rows in portions(source):
            filled = {name: [value_of(row, name) for row in rows] for name in columns}
            filled |= noise_of(source, rows) if noise else {}
            writer.write_table(table(filled, schema=schema))
            done += len(rows)
            told(done)


def encodings(columns: tuple[str, ...], *, noise: bool) -> dict[str, list[str]]:
    """How columns become bytes: texts that repeat once each, floats split into their bytes."""
    of = {kind: [name for name in columns if COLUMNS[name].kind is kind] for kind in Kind}
    inside_lists = [f"{axis}.list.element" for axis in NOISE if noise]
    return {
        "use_dictionary": of[Kind.TEXT],
        "use_byte_stream_split": of[Kind.NUMBER] + inside_lists,
    }


def schema_of(columns: tuple[str, ...], origin: Origin, *, noise: bool) -> Any:
    """The types of the columns; what they say is their metadata, the origin that of the file."""
    import pyarrow as pa

    types = {
        Kind.NUMBER: pa.float64(),
        Kind.WHOLE: pa.int64(),
        Kind.TEXT: pa.string(),
        Kind.FLAG: pa.bool_(),
    }
    told = [COLUMNS[name] for name in columns]
    fields = [pa.field(c.name, types[c.kind], metadata={"words": c.words}) for c in told]
    each = pa.list_(pa.field("element", pa.float32()))
    axes = [pa.field(axis, each, metadata={"words": "z_t [sigma]"}) for axis in NOISE if noise]
    said = msgspec.json.encode(origin)
    return pa.schema(fields + axes, metadata=dict.fromkeys(KEYS, said))


def noise_of(source: Source, rows: tuple[EpisodeRow, ...]) -> dict[str, list[Any]]:
    """The noise of some rows, one list for each axis; none of those that were pruned."""
    there = [row.index for row in rows if row.noise_pruned_ms is None]
    results = source.store.episodes.finished(source.campaign, there)
    noise = {result.index: result.noise.z.T for result in results}
    return {
        axis: [noise[row.index][number] if row.index in noise else None for row in rows]
        for number, axis in enumerate(NOISE)
    }
