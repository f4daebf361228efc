"""A reproduction in Markdown, and its numbers as claims."""

import re

import msgspec
import pytest

from eigenfail.values.estimates import Interval
from eigenfail_reproduction.page import format_page, list_claims
from eigenfail_reproduction.paper import (
    PaperColumn,
    PaperNumber,
    PaperReproduction,
    PaperRow,
    PaperStatement,
    PaperTable,
)

MARK = re.compile(r"(\S+) %? ?(\[[^]]*\])?<!-- claim (\S+) -->")


@pytest.fixture
def found():
    columns = (
        PaperColumn("failure_rate", "failure rate", "share"),
        PaperColumn("log_p", "log p", "nat"),
    )
    row = PaperRow(
        "ast evaluation",
        (PaperNumber(0.9471, 300, Interval(0.91, 0.97), paper=0.946), PaperNumber(-212.34, 284)),
        campaign=3,
    )
    none = PaperRow(
        "monte_carlo rulebook", (PaperNumber(0.0, 2000, paper=0.0), PaperNumber(None, 0))
    )
    table = PaperTable("evaluation", "Evaluation", columns, (row, none), "By step.")
    statement = PaperStatement("AST fails more.", None, "nobody knows", rule="more often")
    return PaperReproduction("full", 5, (table,), (statement,))


def test_every_number_is_a_claim(found):
    names = list_claims(found)
    assert set(names) == {
        "paper.evaluation.ast_evaluation.failure_rate",
        "paper.evaluation.ast_evaluation.log_p",
        "paper.evaluation.monte_carlo_rulebook.failure_rate",
    }
    rate = names["paper.evaluation.ast_evaluation.failure_rate"]
    assert (rate.value, rate.unit, rate.n, rate.paper) == (0.9471, "share", 300, 0.946)


def test_the_page_marks_each_number_and_sets_the_papers_beside_it(found):
    text = format_page(found)
    assert "--scale full" in text
    assert "| | n | failure rate [%] | paper | log p [nat] |" in text
    assert "0 of 1 comparisons with the\npaper's statements hold here" in text
    assert (
        "| ast evaluation | 300 | 94.7 % [91.0, 97.0]<!-- claim "
        "paper.evaluation.ast_evaluation.failure_rate --> | 94.6 | −212<!-- claim "
        "paper.evaluation.ast_evaluation.log_p --> |" in text
    )
    assert "| monte_carlo rulebook | 2,000 | 0 %<!-- claim " in text
    assert text.count("| – |") == 1
    assert "| AST fails more. | cannot be decided | more often | nobody knows |" in text
    caption = "seed 5 of Monte Carlo and training, 1005 of evaluations. By step.\n\n| | n |"
    assert caption in text, "what a table shows is said above it"


def test_numbers_of_the_drive_have_names_of_their_own(found):
    driven = msgspec.structs.replace(found, scenario="highway_drive")
    names = {name.replace("paper.", "paper.drive.", 1) for name in list_claims(found)}
    assert set(list_claims(driven)) == names
    text = format_page(driven)
    assert "`eigenfail reproduce --scenario highway_drive --scale full` runs its" in text
    assert text.count("<!-- claim paper.drive.evaluation.") == 3
    assert "p(x) (white noise of the paper's sigma) on every vehicle; seed 5 of Monte" in text
    assert "cut_in` was tuned" not in text
