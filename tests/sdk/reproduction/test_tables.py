"""The paper's tables with our numbers beside its own."""

from eigenfail.reproduction import tables as published
from eigenfail.reproduction.page import format_heading, format_number, format_paper_number
from eigenfail.reproduction.tables import PaperColumn, PaperNumber, build_campaign_tables
from eigenfail.values import Interval


def tables(summaries):
    return {table.name: table for table in build_campaign_tables(summaries)}


def cell(table, row, column):
    place = [each.name for each in table.columns].index(column)
    return next(each for each in table.rows if each.name == row).numbers[place]


def test_each_table_has_the_papers_rows(summaries):
    found = tables(summaries)
    assert list(found) == ["planners", "sweep", "training", "evaluation", "generalisation"]
    assert {row.name for row in found["sweep"].rows} == set(published.SWEEP)
    assert len(found["training"].rows) == 4
    assert len(found["evaluation"].rows) == 5
    assert len(found["generalisation"].rows) == 6


def test_our_number_stands_beside_the_papers(summaries):
    found = tables(summaries)
    rate = cell(found["evaluation"], "ast_paper evaluation", "failure_rate")
    assert (rate.value, rate.n, rate.paper) == (0.5, 300, 0.946)
    assert rate.interval == Interval(0.47, 0.53)
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
    assert format_number(share, number) == "12.3 [10.0, 15.0]"
    assert format_paper_number(share, number) == " (paper 3.1)"
    assert format_heading(share) == "rate [%]"
    printed = {-1234.5: "-1234", -12.345: "-12.3", 2.345: "2.35", 5.5e-5: "5.5e-05", 0.0: "0.00"}
    assert {value: format_number(nat, PaperNumber(value, 3)) for value in printed} == printed
    assert format_number(nat, PaperNumber(None, 0)) == "–"
    assert format_paper_number(nat, PaperNumber(1.0, 1)) == ""
