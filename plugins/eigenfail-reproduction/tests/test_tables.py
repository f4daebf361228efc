"""The paper's tables with our numbers beside its own."""

from eigenfail.intervals import find_interval
from eigenfail.values.estimates import Interval
from eigenfail_reproduction.page import format_heading, format_our_number, format_paper_number
from eigenfail_reproduction.paper import REPLAYED, SWEEP, PaperColumn, PaperNumber
from eigenfail_reproduction.programme import PROGRAMMES
from eigenfail_reproduction.tables import build_campaign_tables


def tables(summaries):
    return {table.name: table for table in build_campaign_tables(summaries, PROGRAMMES["cut_in"])}


def cell(table, row, column):
    place = [each.name for each in table.columns].index(column)
    return next(each for each in table.rows if each.name == row).numbers[place]


def test_each_table_has_the_papers_rows(summaries):
    found = tables(summaries)
    assert list(found) == ["planners", "sweep", "training", "evaluation", "generalisation"]
    assert {row.name for row in found["sweep"].rows} == set(SWEEP)
    assert len(found["training"].rows) == 4
    assert len(found["evaluation"].rows) == 6
    assert len(found["generalisation"].rows) == 6


def test_our_number_stands_beside_the_papers(summaries):
    found = tables(summaries)
    rate = cell(found["evaluation"], "ast_paper evaluation", "failure_rate")
    assert (rate.value, rate.n, rate.paper) == (0.5, 300, 0.946)
    assert rate.interval == find_interval(150, 300), "independent draws from one trained searcher"
    for table, row in (("sweep", "sweep base"), ("training", "difs")):
        searched = cell(found[table], row, "failure_rate")
        assert (searched.value, searched.interval) == (0.5, None), "a search is no random sample"
    ours = cell(found["evaluation"], "ast evaluation", "failure_rate")
    assert ours.paper == 0.946, "our defaults are held against the same number"
    assert cell(found["training"], "difs_paper", "cost_usd").paper == 0.648


def test_no_failure_leaves_gaps_not_zeros(summaries):
    found = tables(summaries)
    severity = cell(found["planners"], "monte_carlo rulebook", "severity")
    assert severity.value is None
    assert severity.n == 0


def test_campaigns_that_are_not_there_have_no_row(summaries):
    del summaries["sweep alpha=500"]
    names = {row.name for row in tables(summaries)["sweep"].rows}
    assert "sweep alpha=500" not in names


def test_numbers_are_told_in_their_units():
    share, nat = PaperColumn("a", "rate", "share"), PaperColumn("b", "log p", "nat")
    number = PaperNumber(0.1234, 300, Interval(0.1, 0.15), paper=0.031)
    assert format_our_number(share, number) == "12.3 % [10.0, 15.0]"
    assert format_paper_number(share, number) == " (paper 3.1)"
    assert format_heading(share) == "rate [%]"
    printed = {-1234.5: "−1,235", -12.345: "−12.3", 2.346: "2.35", 5.5e-5: "5.50×10⁻⁵", 0.0: "0"}
    assert {value: format_our_number(nat, PaperNumber(value, 3)) for value in printed} == printed
    assert format_our_number(nat, PaperNumber(None, 0)) == "–"
    assert format_paper_number(nat, PaperNumber(1.0, 1)) == ""


def test_shares_of_a_few_and_of_none_are_told_as_counts():
    share, replays = PaperColumn("a", "rate", "share"), PaperColumn("b", "replays", REPLAYED)
    none = PaperNumber(0.0, 2000, find_interval(0, 2000))
    assert format_our_number(share, none) == "0 of 2,000: ≤ 0.150 %"
    assert format_our_number(share, PaperNumber(0.0, 1000)) == "0 %"
    assert format_our_number(replays, PaperNumber(2 / 3, 6, paper=1.0)) == "4 of 6"
    assert format_paper_number(replays, PaperNumber(2 / 3, 6, paper=1.0)) == " (paper all)"
    modes = PaperColumn("c", "modes", "modes")
    assert format_our_number(modes, PaperNumber(2.0, 300, paper=3.0)) == "2"
    usd = PaperColumn("d", "cost", "USD")
    cost = PaperNumber(0.25, 4, Interval(0.1001, 0.5999))
    assert format_our_number(usd, cost) == "0.250 [0.100, 0.600]"
