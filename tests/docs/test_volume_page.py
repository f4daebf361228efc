"""docs/scale.md shows what `make volume` has measured of a million episodes."""

import json

import pytest


@pytest.fixture
def volume(benchmark):
    """The script that writes the table."""
    return benchmark("volume_table")


@pytest.fixture
def page(root):
    return (root / "docs" / "scale.md").read_text()


def test_the_table_is_what_was_measured(page, volume):
    begin, end = volume.MARKS
    shown = page.split(begin)[1].split(end)[0].strip().splitlines()
    assert shown == [*volume.table(volume.latest())]


UNMEASURED = {"restore_s", "writing_while_backup_per_s", "longest_commit_while_backup_s"}
"""Of PostgreSQL; the page says so."""


def test_every_figure_is_in_the_table_and_was_measured_on_both(root, volume):
    measured = json.loads((root / "benchmarks" / "volume.json").read_text())
    told = {name for row in volume.ROWS for name in row.names} | {"verify_mb", "prune_mb"}
    missing = {f"{place}_{name}" for place in volume.PLACES for name in told} - set(measured)
    assert missing <= {f"postgres_{name}" for name in UNMEASURED | {"prune_mb"}}
    whole = {"ingest_per_s", "bytes_per_episode", "verify_s", "backup_s", "vacuum_s"}
    for name in (f"{place}_{each}" for place in volume.PLACES for each in whole):
        assert measured[name]["n"] >= 1_000_000, name


def test_figures_are_told_to_as_many_digits_as_they_are_worth(volume):
    told = {0.0123: "0.012", 1.26: "1.3", 12.34: "12.3", 123.4: "123", 12_345.0: "12,300"}
    assert {value: volume.words(value) for value in told} == told
    assert volume.cell({}, "sqlite", "nothing") == "–"
