"""docs/reproduction_drive.md is what the kept runs say, and so are the claims."""

from statistics import median

import msgspec
import pytest

from eigenfail_reproduction.programme import LEARNERS, SCALES
from eigenfail_reproduction.seeds import SeedVerdict, judge_over_seeds


@pytest.fixture
def benchmark(import_benchmark):
    return import_benchmark("reproduction_drive")


def test_the_page_is_that_of_the_kept_runs(benchmark, root):
    page = (root / "docs" / "reproduction_drive.md").read_text()
    assert page == benchmark.format_page(benchmark.read()), f"run `python {benchmark.__file__}`"


def test_the_first_seed_has_all_campaigns_and_the_others_the_learners(benchmark):
    found = benchmark.read()
    assert [each.scale for each in found] == ["full", *["learners"] * (len(found) - 1)]
    assert {each.scenario for each in found} == {"highway_drive"}
    first = found[0].seed
    assert [each.seed for each in found] == list(range(first, first + benchmark.SEEDS))
    for each in found:
        scale = SCALES[each.scale]
        for learner in LEARNERS:
            assert benchmark.find_rate(each, "training", learner).n == scale.training
            evaluated = benchmark.find_rate(each, "evaluation", f"{learner} evaluation")
            assert evaluated.n == scale.evaluation


def test_each_verdict_has_a_reason_in_a_sentence(benchmark):
    judged = judge_over_seeds(benchmark.read())
    assert set(benchmark.REASONS) == {(one.paper, one.subject) for one in judged}
    assert all(reason.endswith(".") for reason in benchmark.REASONS.values())


def test_counts_of_verdicts_add_up(benchmark):
    found = benchmark.read()
    judged = judge_over_seeds(found)
    figures = dict(benchmark.list_figures(found))
    parts = ("paper.drive.holds", "paper.drive.refuted", "paper.drive.undecided")
    asked = figures["paper.drive.asked"].value
    assert sum(figures[name].value for name in parts) == asked
    unasked = [one for one in judged if one.verdict is SeedVerdict.CANNOT_BE_ASKED]
    assert asked == len(judged) - len(unasked)


def test_rates_over_the_seeds_are_medians_and_one_training_has_an_interval(benchmark):
    found = benchmark.read()
    figures = dict(benchmark.list_figures(found))
    for learner in LEARNERS:
        rates = [benchmark.find_rate(each, "evaluation", f"{learner} evaluation") for each in found]
        one = figures[f"paper.drive.learners.{learner}.eval300.failure_rate"]
        assert one.interval[0] <= one.value <= one.interval[1]
        several = figures[f"paper.drive.learners.{learner}.eval100.failure_rate"]
        assert several.n == sum(rate.n for rate in rates[1:])
        assert several.value == median(rate.value for rate in rates[1:])
        assert several.interval is None, "searchers of different seeds are no sample"


def test_its_numbers_are_the_claims(benchmark, root):
    stated = msgspec.json.decode((root / "benchmarks" / "results" / "claims.json").read_bytes())
    kept = dict(benchmark.list_figures(benchmark.read()))
    assert {name: stated[name].get("value") for name in kept} == {
        name: figure.value for name, figure in kept.items()
    }
    assert {name for name in stated if name.startswith(benchmark.PREFIXES)} == set(kept)


def test_runs_are_written_and_read(benchmark, tmp_path):
    runs = benchmark.SeedRuns(benchmark.read())
    runs.write_beside(tmp_path / "claims.json")
    assert benchmark.read(tmp_path / "reproduction_drive.json") == runs.found
