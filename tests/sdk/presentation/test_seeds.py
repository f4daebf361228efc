"""Words and tables of campaigns over seeds."""

import pytest
from msgspec.structs import replace

from eigenfail.presentation import seeds
from eigenfail.presentation.tables import format_line
from eigenfail.values.estimates import Cost, Interval
from eigenfail.values.seeds import FirstFailures, SeedFigure, SeedSpread, SeedValue

SHARE = SeedFigure(
    n=3, mean=0.5, deviation=0.1, least=0.4, median=0.5, most=0.6, interval=Interval(0.25, 0.75)
)
SAME = replace(SHARE, deviation=0.0, least=0.5, most=0.5, interval=None)
SPREAD = SeedSpread(
    name="alpha=5",
    method="ast",
    campaigns=(7, 8, 9),
    seeds=(1, 2, 3),
    completed=1200,
    failures=600,
    share=SHARE,
    worst=SeedValue(2, 8, 0.4),
    log_probability_per_step=None,
    mean_severity=None,
    first=FirstFailures(median=12.5, worst=1040, worst_seed=3, without=0, within=4000),
    cost=Cost(3.0, 2.0, 0.005, Interval(0.004, 0.0075), 0.004),
    notes=("A note.",),
)
NOTHING = replace(
    SPREAD,
    failures=0,
    share=replace(SAME, mean=0.0, least=0.0, median=0.0, most=0.0),
    first=FirstFailures(median=None, worst=None, worst_seed=1, without=3, within=400),
    cost=Cost(3.0, 2.0, None, None, 0.001),
)


def lines(spread):
    """The rows of its table, by their names."""
    table = seeds.tabulate_spreads([spread])
    return {row[0].line: [cell.line for cell in row[1:]] for row in table.cells}


def test_a_row_of_means_stands_in_the_columns_of_results():
    cells = [format_line(cell) for cell in seeds.list_spread(SPREAD)]
    assert cells == [
        "1,200",
        "600",
        "50.0 % [25.0, 75.0]",
        *("–",) * 3,
        "0.00500 [0.00400, 0.00750]",
    ]
    assert seeds.label_spread(SPREAD, is_only=True) == "mean over 3 seeds"
    assert seeds.label_spread(SPREAD, is_only=False) == "alpha=5: mean over 3 seeds"


def test_each_figure_has_its_spread_and_the_worst_seed_beside_the_median():
    found = lines(SPREAD)
    share = ["50.0 % [25.0, 75.0]", "10.0 %", "40.0 %", "50.0 %", "60.0 %", "2 (40.0 %)"]
    assert found["Share of episodes that failed"] == share
    assert found["Episodes to the first failure"][3:] == ["12.5", "1,040", "3 (latest)"]
    assert found["log p/step of the failures [nats]"] == ["–"] * 6


def test_the_share_is_told_in_the_same_words_everywhere():
    share, note = seeds.tabulate_spreads([SPREAD]).notes
    assert share == (
        "Share of episodes that failed, mean over 3 seeds [95 % interval of the mean]: 50.0 % "
        "[25.0, 75.0]; median 50.0 %, fewest 40.0 %, with seed 2."
    )
    assert note == "A note."


def test_groups_are_told_apart():
    table = seeds.tabulate_spreads([SPREAD, replace(SPREAD, name="alpha=9")])
    assert [column.title for column in table.columns[:2]] == ["Group", "Over seeds"]
    assert {row[0].value for row in table.cells} == {"alpha=5, 3 seeds", "alpha=9, 3 seeds"}
    assert table.notes[0].startswith("alpha=5: Share of episodes that failed")
    assert table.notes.count("A note.") == 1


def test_equal_values_are_said_to_be_equal():
    spread = replace(SPREAD, share=SAME)
    assert lines(spread)["Share of episodes that failed"][0] == "50.0 % (the same for 3 seeds)"
    assert lines(spread)["Share of episodes that failed"][-1] == "–"
    assert (
        "50.0 % with each of 3 seeds. Equal values show no spread"
        in (seeds.tabulate_spreads([spread]).notes[0])
    )


def test_without_a_failure_the_cost_is_a_bound():
    found, notes = lines(NOTHING), seeds.tabulate_spreads([NOTHING]).notes
    assert found["Cost per failure, total ÷ all [USD]"][0] == "≥ 0.00100"
    assert found["Episodes to the first failure"][3:] == ["–", "none in 400 episodes", "1 (latest)"]
    assert "No seed found a failure: the cost per failure is a lower bound (95 %)." in notes
    assert notes[0].startswith("Share of episodes that failed: 0 % with each of 3 seeds.")


@pytest.mark.parametrize(
    ("cost", "cell", "note"),
    [
        (Cost(3.0, 2.0, 0.005, None, 0.001), "0.00500 [0.00100, ∞)", seeds.OPEN_ABOVE),
        (Cost(3.0, 2.0, 0.005, None, None), "0.00500", seeds.NO_INTERVAL),
    ],
)
def test_what_is_missing_of_the_interval_of_the_cost_is_said(cost, cell, note):
    spread = replace(SPREAD, cost=cost)
    assert lines(spread)["Cost per failure, total ÷ all [USD]"][0] == cell
    assert note in seeds.tabulate_spreads([spread]).notes


def test_seeds_without_a_failure_are_counted_in_words():
    severity = replace(SHARE, n=2)
    found = replace(SPREAD, first=replace(SPREAD.first, without=1, worst=None))
    found = replace(found, log_probability_per_step=severity)
    assert (
        "Seeds without a failure, 1 of 3, count in the share, in the first failure and in the cost "
        "per failure; log p and severity are of the other 2."
    ) in seeds.tabulate_spreads([found]).notes
