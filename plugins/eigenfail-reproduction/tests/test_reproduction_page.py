"""docs/reproduction.md is what the kept runs say, and so are the claims."""

import msgspec
import pytest

from eigenfail_reproduction import captions, tables
from eigenfail_reproduction.programme import PROGRAMMES, SCALES
from eigenfail_reproduction.seeds import SeedVerdict, judge_over_seeds

CUT_IN = PROGRAMMES["cut_in"]


@pytest.fixture
def benchmark(import_benchmark):
    return import_benchmark("reproduction")


def test_the_page_is_that_of_the_kept_runs(benchmark, root):
    page = (root / "docs" / "reproduction.md").read_text()
    assert page == benchmark.format_page(benchmark.read()), f"run `python {benchmark.__file__}`"
    for name in benchmark.PICTURES:
        assert f"(reproduction/{name}.svg)" in page
        assert "<svg" in (root / "docs" / "reproduction" / f"{name}.svg").read_text()


def test_each_verdict_has_a_reason_in_sentences(benchmark):
    judged = judge_over_seeds(benchmark.read())
    assert set(benchmark.REASONS) == {(one.paper, one.subject) for one in judged}
    assert all(reason.endswith(".") for reason in benchmark.REASONS.values())


def test_each_seed_has_all_campaigns_at_full_scale(benchmark):
    found = benchmark.read()
    assert {each.scale for each in found} == {"full"}
    first = found[0].seed
    assert [each.seed for each in found] == list(range(first, first + benchmark.SEEDS))
    for each in found:
        trained = benchmark.over_seeds.find_numbers(each, "training", "ast_paper")
        assert trained["failure_rate"].n == SCALES["full"].training


def test_its_captions_are_those_of_the_program(benchmark):
    for found in benchmark.read():
        assert {table.name: table.note for table in found.tables} == {
            **{layout.name: layout.note for layout in tables.list_layouts(CUT_IN)},
            "safety": captions.OF_SAFETY,
            "components": captions.OF_COMPONENTS,
            "eigenfailures": tables.describe_replays(CUT_IN),
        }


def test_counts_of_verdicts_add_up(benchmark):
    found = benchmark.read()
    judged = judge_over_seeds(found)
    figures = dict(benchmark.list_figures(found))
    parts = ("paper.holds", "paper.refuted", "paper.undecided")
    asked = figures["paper.asked"].value
    assert sum(figures[name].value for name in parts) == asked
    unasked = [one for one in judged if one.verdict is SeedVerdict.CANNOT_BE_ASKED]
    assert asked == len(judged) - len(unasked)


def test_a_number_is_the_median_of_its_seeds(benchmark):
    found = benchmark.read()
    figures = dict(benchmark.list_figures(found))
    values = sorted(
        benchmark.over_seeds.find_numbers(each, "training", "ast_paper")["log_p"].value
        for each in found
    )
    figure = figures["paper.training.ast_paper.log_p"]
    assert (figure.value, figure.spread) == (values[2], (values[0], values[-1]))
    assert figure.paper == -4506.13


def test_draws_from_one_distribution_are_counted_over_all_seeds(benchmark):
    figures = dict(benchmark.list_figures(benchmark.read()))
    drawn = figures["paper.planners.monte_carlo_rulebook.failure_rate"]
    assert drawn.n == benchmark.SEEDS * SCALES["full"].monte_carlo
    assert drawn.interval[0] <= drawn.value <= drawn.interval[1]
    assert figures["paper.evaluation.ast_evaluation.failure_rate"].interval is None


def test_its_numbers_are_the_claims(benchmark, root):
    stated = msgspec.json.decode((root / "benchmarks" / "results" / "claims.json").read_bytes())
    kept = dict(benchmark.list_figures(benchmark.read()))
    assert {name: stated[name].get("value") for name in kept} == {
        name: figure.value for name, figure in kept.items()
    }
    prefixes = (*benchmark.PREFIXES, "cut_in.eigenfailures.")
    assert {name for name in stated if name.startswith(prefixes)} == set(kept)


def test_runs_are_written_with_their_pictures(benchmark, tmp_path):
    runs = benchmark.Runs(benchmark.read(), {"scores": b"<svg/>"})
    runs.write_beside(tmp_path / "claims.json")
    assert benchmark.read(tmp_path / "reproduction.json") == runs.found
    assert (tmp_path / "reproduction" / "scores.svg").read_bytes() == b"<svg/>"
