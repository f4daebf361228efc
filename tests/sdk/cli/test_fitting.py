"""Tables fit the screen: nothing is broken inside a word, and what is left out is said."""

import pytest
from msgspec.structs import replace
from rich.console import Console

from eigenfail.cli.render import PLAIN_WIDTH
from eigenfail.presentation.campaigns import tabulate_campaigns, tabulate_results
from eigenfail.presentation.tables import Table, count_columns, name_columns
from eigenfail.presentation.terminal import ALWAYS, render
from eigenfail.values.campaign import Campaign, CampaignState, Counts
from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail.values.estimates import Cost
from eigenfail.values.summary import Summary, Unresolved

COST = Cost(12.0, 10.0, None, None, 0.5)


def campaign(number):
    spec = CampaignSpec(name=f"a long name of campaign {number}", method="monte_carlo", episodes=9)
    counts = Counts(1000, 400, 12)
    return Campaign(
        id=number, spec=spec, state=CampaignState.RUNNING, counts=counts, created_ms=10**12
    )


def summary(number):
    return Summary(number, "n", "monte_carlo", Counts(9), None, -250.5, -2.5, 80.1, 35.2, COST)


def drawn(grid, width):
    console = Console(width=width, highlight=False, color_system=None)
    with console.capture() as capture:
        console.print(grid)
    return [line.rstrip() for line in capture.get().splitlines()]


def test_a_failure_rate_has_its_remark_below() -> None:
    ended = replace(summary(23), counts=Counts(9, 9), unresolved=Unresolved(2, 10.0))
    *_, line = drawn(render(tabulate_results([summary(1), ended])), 200)
    assert line == (
        "Campaign 23: 2 of 9 had no collision within 10 s, but ended while braking could not avoid "
        "one any more. Upper bounds count such episodes as failures."
    )


TABLES = {
    "campaigns": tabulate_campaigns([campaign(1), campaign(23)]),
    "results": tabulate_results([summary(1), summary(23)]),
}


@pytest.mark.parametrize("width", [40, 80, 120, 200])
@pytest.mark.parametrize("name", TABLES)
def test_no_line_is_wider_than_the_screen_and_no_figure_is_broken(name, width):
    lines = drawn(render(TABLES[name]), width)
    assert max(map(len, lines)) <= width
    ids = [line.split()[0] for line in lines[2:] if line.strip()[:1].isdigit()]
    assert [each for each in ids if each in {"1", "23"}] == ["1", "23"]


def test_what_matters_least_goes_first_and_is_named():
    lines = drawn(render(TABLES["campaigns"]), 80)
    header, said = lines[0], " ".join(lines[-2:])
    assert "created" not in header
    assert "failures" in header
    assert "Too narrow for: " in said
    assert "created" in said
    assert "--json" in said


def test_a_wide_screen_has_all_of_it():
    lines = drawn(render(TABLES["results"]), 200)
    for column in TABLES["results"].columns:
        assert column.label in lines[0]
    assert not any("Too narrow" in line for line in lines)


def test_columns_without_a_rank_go_from_the_right_and_the_first_ones_stay():
    columns = count_columns(*(f"Column {number}" for number in range(9)))
    grid = render(Table("", columns, (("1",) * 9,)))
    header = drawn(grid, 40)[0]
    assert header.split("column")[1:] == [" 0 ", " 1 ", " 2 ", " 3"]
    assert len(drawn(grid, 10)[0].split("column")) - 1 <= ALWAYS


def test_texts_are_broken_between_words_before_a_column_goes():
    remark = "a remark that is far longer than the screen is wide, " * 2
    table = Table("", name_columns("What", "Found"), (("folder", remark),))
    lines = drawn(render(table), 40)
    assert lines[0].split() == ["what", "found"]
    assert len(lines) > 3


def test_a_pipe_has_every_column_on_one_line(eigenfail, done):
    listed = eigenfail("campaign", "list").stdout.splitlines()
    assert len(listed) == 3
    assert "created" in listed[0]
    assert PLAIN_WIDTH > 500


def test_a_narrow_terminal_is_obeyed_by_the_command(eigenfail, done, monkeypatch):
    monkeypatch.setenv("TTY_COMPATIBLE", "1")
    monkeypatch.setenv("COLUMNS", "60")
    listed = eigenfail("campaign", "list").stdout
    assert "Too narrow for" in listed
