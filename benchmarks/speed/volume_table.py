"""The table of benchmarks/scale.md that says what a million episodes take, out of volume.json.

`python -m benchmarks.speed.volume_table` writes it into the page.
"""

from collections.abc import Iterator, Mapping
from typing import NamedTuple

import msgspec
from benchmarks.figures import RESULTS, ROOT, Figure

PAGE = ROOT / "benchmarks" / "scale.md"
MEASURED = RESULTS / "volume.json"
MARKS = "<!-- episodes -->", "<!-- /episodes -->"
HEADS = ("what", "figure", "SQLite", "PostgreSQL")
PLACES = ("sqlite", "postgres")
MEGA = 1_000_000.0


class Row(NamedTuple):
    """A line: what was done, and the figures of it."""

    words: str
    names: tuple[str, ...]


ROWS = (
    Row("filling the database by one process, in commits of 256 results: episodes ÷ time in"
        " commits, from empty to a million [episodes/s]", ("ingest_per_s",)),
    Row("on the disk [bytes per episode]", ("bytes_per_episode",)),
    Row("100 rows, nine tenths deep: by index, by robustness, under a filter [ms]",
        ("page_by_index_ms", "page_by_robustness_ms", "page_filtered_ms")),
    Row("the 100 severest failures of the largest campaign [ms]",
        ("failures_by_severity_ms",)),
    Row("summary of the largest campaign: for the first time, again [ms]",
        ("summary_first_ms", "summary_ms")),
    Row("course, safety measures of the largest campaign [ms]", ("course_ms", "safety_ms")),
    Row("the overview's page [ms]", ("overview_ms",)),
    Row("analysis of the failures of the largest campaign, one in fifty of it [s], [MiB]",
        ("analysis_s", "analysis_mb")),
    Row("export of the largest campaign as CSV [episodes/s], [MiB]", ("csv_per_s", "csv_mb")),
    Row("the same as Parquet [episodes/s], [MiB]", ("parquet_per_s", "parquet_mb")),
    Row("the same as Parquet with noise [episodes/s], [MiB]",
        ("parquet_noise_per_s", "parquet_noise_mb")),
    Row("`db verify` [s]", ("verify_s",)),
    Row("`db backup` while a writer runs [s], [MB]", ("backup_s", "backup_bytes")),
    Row("the writer during that backup: [episodes/s], longest commit [s]",
        ("writing_while_backup_per_s", "longest_commit_while_backup_s")),
    Row("`db restore` [s]", ("restore_s",)),
    Row("`db prune --dry-run` [s]", ("rehearse_s",)),
    Row("`db prune` while a writer runs [episodes/s]", ("prune_per_s",)),
    Row("the writer during that pruning: [episodes/s], longest commit [s]",
        ("writing_while_prune_per_s", "longest_commit_while_prune_s")),
    Row("`db vacuum` [s], given back [MB]", ("vacuum_s", "vacuum_bytes")),
    Row("`db verify` after that [s]", ("verify_pruned_s",)),
)  # fmt: skip


def latest() -> dict[str, Figure]:
    """What was measured last."""
    return msgspec.json.decode(MEASURED.read_bytes(), type=dict[str, Figure])


def table(figures: Mapping[str, Figure]) -> Iterator[str]:
    """Its lines."""
    yield f"| {' | '.join(HEADS)} |"
    yield "|---|---|--:|--:|"
    for row in ROWS:
        names = ", ".join(f"`{name}`" for name in row.names)
        cells = (", ".join(cell(figures, place, name) for name in row.names) for place in PLACES)
        yield f"| {row.words} | {names} | {' | '.join(cells)} |"


def cell(figures: Mapping[str, Figure], place: str, name: str) -> str:
    """A figure to three digits; bytes of a whole database in MB."""
    figure = figures.get(f"{place}_{name}")
    if figure is None or figure.value is None:
        return "–"
    value = figure.value / MEGA if name in IN_MEGABYTES else figure.value
    return words(value)


IN_MEGABYTES = frozenset({"backup_bytes", "vacuum_bytes"})
ROUND, TEN = 100.0, 10.0


def words(value: float) -> str:
    """A number with as many digits as it is worth."""
    if abs(value) >= ROUND:
        return f"{float(f'{value:.3g}'):,.0f}"
    return f"{value:.1f}" if abs(value) >= TEN else f"{value:.2g}"


def main() -> None:
    """Put the table in its place."""
    page = PAGE.read_text()
    before, rest = page.split(MARKS[0])
    after = rest.split(MARKS[1])[1]
    lines = "\n".join((MARKS[0], *table(latest()), MARKS[1]))
    PAGE.write_text(f"{before}{lines}{after}")


if __name__ == "__main__":
    main()
