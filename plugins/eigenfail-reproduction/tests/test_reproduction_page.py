"""docs/reproduction.md is what the kept run says, and so are the claims."""

from types import SimpleNamespace

import msgspec
import pytest

from eigenfail_reproduction import captions, tables
from eigenfail_reproduction.page import list_claims
from eigenfail_reproduction.programme import PROGRAMMES, SCALES

CUT_IN = PROGRAMMES["cut_in"]


@pytest.fixture
def benchmark(import_benchmark):
    return import_benchmark("reproduction")


def test_the_page_is_that_of_the_kept_run(benchmark, root):
    page = (root / "docs" / "reproduction.md").read_text()
    assert page == benchmark.illustrate_page(benchmark.read()), f"run `python {benchmark.__file__}`"
    for name in benchmark.PICTURES:
        assert f"(reproduction/{name}.svg)" in page
        assert "<svg" in (root / "docs" / "reproduction" / f"{name}.svg").read_text()


def test_every_statement_that_does_not_hold_says_why(root):
    page = (
        (root / "docs" / "reproduction.md").read_text().partition("## Statements of the paper")[2]
    )
    rows = [line.split(" | ") for line in page.splitlines() if line.startswith("| ")][1:]
    why = [row[-1].strip(" |") for row in rows if row[1] != "holds"]
    assert len(why) == 12
    assert all(sentence.endswith(".") for sentence in why)


def test_it_is_a_run_at_full_scale(benchmark):
    found = benchmark.read()
    assert found.scale == "full"
    trained = {row.name: row.numbers[1].n for table in found.tables[2:3] for row in table.rows}
    assert set(trained.values()) == {SCALES["full"].training}


def test_its_captions_are_those_of_the_program(benchmark):
    kept = {table.name: table.note for table in benchmark.read().tables}
    assert kept == {
        **{layout.name: layout.note for layout in tables.list_layouts(CUT_IN)},
        "safety": captions.OF_SAFETY,
        "components": captions.OF_COMPONENTS,
        "eigenfailures": tables.describe_replays(CUT_IN),
    }


def test_its_numbers_are_the_claims(benchmark, root):
    stated = msgspec.json.decode((root / "benchmarks" / "results" / "claims.json").read_bytes())
    kept = list_claims(benchmark.read())
    assert {name: stated[name].get("value") for name in kept} == {
        name: claim.value for name, claim in kept.items()
    }
    assert {name for name in stated if name.startswith(benchmark.PREFIXES)} == set(kept)


def test_a_run_is_written_with_its_pictures(benchmark, tmp_path):
    run = SimpleNamespace(found=benchmark.read(), pictures={"scores": b"<svg/>"})
    benchmark.write(run, tmp_path / "reproduction.json")
    assert benchmark.read(tmp_path / "reproduction.json") == run.found
    assert (tmp_path / "reproduction" / "scores.svg").read_bytes() == b"<svg/>"
