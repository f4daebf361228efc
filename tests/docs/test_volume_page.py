"""benchmarks/scale.md shows what benchmarks/speed/volume.py has measured of a million episodes."""

import json

import pytest


@pytest.fixture
def volume(benchmark):
    """The script that writes the table."""
    return benchmark("benchmarks.speed.volume_table")


@pytest.fixture
def page(root):
    return (root / "benchmarks" / "scale.md").read_text()


def test_the_table_is_what_was_measured(page, volume):
    begin, end = volume.MARKS
    shown = page.split(begin)[1].split(end)[0].strip().splitlines()
    assert shown == [*volume.table(volume.latest())]


FIRST_UNMEASURED = "verify_s"
"""The first row without a figure of PostgreSQL; the page says so."""


def test_every_figure_is_in_the_table_and_was_measured_on_both(root, volume, page):
    measured = json.loads((root / "benchmarks" / "results" / "volume.json").read_text())
    rows = [row.names for row in volume.ROWS]
    unmeasured = {name for row in rows[rows.index((FIRST_UNMEASURED,)) :] for name in row}
    assert "PostgreSQL the rows from `db verify` on have no figures" in page
    told = {name for row in rows for name in row} | {"verify_mb", "prune_mb"}
    missing = {f"{place}_{name}" for place in volume.PLACES for name in told} - set(measured)
    assert missing == {f"postgres_{name}" for name in unmeasured | {"verify_mb", "prune_mb"}}
    assert len(measured) == len(volume.PLACES) * len(told) - len(missing)
    whole = {"sqlite": {"verify_s", "backup_s", "vacuum_s"}, "postgres": set()}
    for place, others in whole.items():
        for name in others | {"ingest_per_s", "bytes_per_episode"}:
            assert measured[f"{place}_{name}"]["n"] == 1_000_000, name


def test_figures_are_told_to_as_many_digits_as_they_are_worth(volume):
    told = {0.0123: "0.012", 1.26: "1.3", 12.34: "12.3", 123.4: "123", 12_345.0: "12,300"}
    assert {value: volume.words(value) for value in told} == told
    assert volume.cell({}, "sqlite", "nothing") == "–"
