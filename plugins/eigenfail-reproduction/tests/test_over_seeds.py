"""Tables over several seeds, from made-up runs."""

import pytest

from eigenfail.intervals import find_interval
from eigenfail_reproduction.paper import (
    REPLAYED,
    DrawCounts,
    PaperColumn,
    PaperNumber,
    PaperReproduction,
    PaperRow,
    PaperTable,
)

RATE, LOG_P = (
    PaperColumn("failure_rate", "failure rate", "share"),
    PaperColumn("log_p", "log p", "nat"),
)


@pytest.fixture
def over_seeds(import_benchmark):
    return import_benchmark("over_seeds")


@pytest.fixture
def reproduction(import_benchmark):
    return import_benchmark("reproduction")


def make_run(seed, **rows):
    """A run with a table `sweep`, whose rows have a share, a log p and the paper's share."""
    made = []
    for number, (name, (share, log_p)) in enumerate(rows.items()):
        share_of = PaperNumber(share, 100, paper=0.1 * number)
        made.append(PaperRow(name, (share_of, PaperNumber(log_p, 0 if log_p is None else 5))))
    table = PaperTable("sweep", "Sweep", (RATE, LOG_P), tuple(made))
    return PaperReproduction("full", seed, (table,), ())


def test_number_is_the_median_and_its_seeds_are_counted(over_seeds):
    runs = [
        make_run(1, a=(0.2, -300.0), b=(0.5, None)),
        make_run(2, a=(0.4, -100.0), b=(0.5, -2.0)),
        make_run(3, b=(0.5, None)),
    ]
    figures = dict(over_seeds.list_figures(runs))
    assert figures["paper.sweep.a.failure_rate"].value == pytest.approx(0.3)
    assert figures["paper.sweep.a.failure_rate"].spread == (0.2, 0.4)
    assert figures["paper.sweep.b.log_p"].n == 5, "the failures of the seeds that have some"
    (table,) = over_seeds.list_tables(runs)
    lines = list(over_seeds.format_grid(runs, table))
    assert lines[0] == "|  | failure rate [%] | paper | log p [nat] |"
    assert (
        "30.0 %<!-- claim paper.sweep.a.failure_rate --> (20.0 to 40.0, 2 of 3 seeds) | 0 |"
        in lines[2]
    )
    assert "50.0 %<!-- claim paper.sweep.b.failure_rate --> | 10 |" in lines[3], "all seeds alike"
    assert "(1 of 3 seeds)" in lines[3]


def test_seed_without_a_table_is_a_seed_without_values(over_seeds):
    runs = [make_run(1, a=(0.2, -1.0)), PaperReproduction("full", 2, (), ())]
    (table,) = over_seeds.list_tables(runs)
    assert "1 of 2 seeds" in list(over_seeds.format_grid(runs, table))[2]


def test_draws_of_one_distribution_are_pooled_with_the_doubtful_ones(over_seeds):
    numbers = tuple(
        PaperNumber(k / 100, 100, find_interval(k, 102, 7), draws=DrawCounts(k, 102, 7))
        for k in (0, 3)
    )
    cell = over_seeds.CellOverSeeds("c", "held", RATE, numbers)
    figure = cell.make_figure()
    ends = find_interval(3, 204, 14)
    assert (figure.value, figure.n) == (0.015, 200)
    assert figure.interval == (ends.low, ends.high)
    trained = over_seeds.CellOverSeeds("c", "ast evaluation", RATE, numbers)
    assert trained.make_figure().interval is None, "searchers of different seeds are no sample"


def test_replays_are_counted_over_all_seeds(over_seeds):
    column = PaperColumn("eigenfailures", "reproduced", REPLAYED)
    numbers = PaperNumber(0.5, 4, paper=1.0), PaperNumber(1.0, 3), PaperNumber(None, 0)
    cell = over_seeds.CellOverSeeds("c", "ast", column, numbers)
    assert (cell.make_figure().value, cell.make_figure().n) == (5 / 7, 7)
    assert cell.format() == "5 of 7<!-- claim c --> (2 of 3 seeds)"


def test_setting_without_an_effect_is_found_whatever_the_paper_prints(reproduction):
    base = (0.5, -300.0)
    runs = [
        make_run(1, **{"sweep base": base, "same once": base, "other": (0.4, -300.0)}),
        make_run(2, **{"sweep base": base, "same once": (0.6, -300.0), "other": (0.4, -300.0)}),
    ]
    assert reproduction.has_effect("other", runs)
    assert not reproduction.has_effect("same once", runs)
    assert not reproduction.has_effect("not run", runs)
