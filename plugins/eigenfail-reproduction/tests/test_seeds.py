"""Verdicts over several seeds, counted by hand."""

import pytest

from eigenfail_reproduction.paper import PaperReproduction, PaperStatement
from eigenfail_reproduction.seeds import SeedVerdict, count_asked, judge_over_seeds

UNASKED = "unasked"


def judge(*answers, paper="AST fails more.", subject="ast"):
    """What becomes of a statement with one answer for each seed."""
    found = [
        PaperReproduction(
            "full",
            seed,
            (),
            (
                PaperStatement(
                    paper,
                    None if answer is UNASKED else answer,
                    "",
                    rule="more often" if answer is not UNASKED else "Not judged",
                    subject=subject,
                    asked=answer is not UNASKED,
                ),
            ),
        )
        for seed, answer in enumerate(answers)
    ]
    (one,) = judge_over_seeds(found)
    return one


@pytest.mark.parametrize(
    ("answers", "verdict", "is_shown"),
    [
        ((True,) * 5, SeedVerdict.HOLDS, True),
        ((True, True, True, False, None), SeedVerdict.HOLDS, True),
        ((True, True, True, UNASKED, UNASKED), SeedVerdict.HOLDS, True),
        ((True, True, False, False, None), SeedVerdict.DOES_NOT_HOLD, True),
        ((True, True, None, None, None), SeedVerdict.DOES_NOT_HOLD, False),
        ((False, None, None, None, None), SeedVerdict.DOES_NOT_HOLD, False),
        ((False, False, False, UNASKED, UNASKED), SeedVerdict.DOES_NOT_HOLD, True),
        ((True, True, UNASKED, UNASKED, UNASKED), SeedVerdict.CANNOT_BE_ASKED, False),
        ((True, UNASKED), SeedVerdict.CANNOT_BE_ASKED, False),
        ((UNASKED,), SeedVerdict.CANNOT_BE_ASKED, False),
        ((True, False), SeedVerdict.DOES_NOT_HOLD, True),
        ((True,), SeedVerdict.HOLDS, True),
        ((False,), SeedVerdict.DOES_NOT_HOLD, True),
        ((None,), SeedVerdict.DOES_NOT_HOLD, False),
    ],
)
def test_most_seeds_decide(answers, verdict, is_shown):
    one = judge(*answers)
    assert (one.verdict, one.is_shown) == (verdict, is_shown)
    assert one.seeds == len(answers)
    assert (one.held, one.refuted) == (answers.count(True), answers.count(False))
    assert (one.undecided, one.unasked) == (answers.count(None), answers.count(UNASKED))


def test_the_rule_is_that_of_a_seed_in_which_it_was_asked():
    assert judge(UNASKED, True, True).rule == "more often"


def test_statements_are_told_apart_by_what_they_are_judged_by():
    """A seed without the sweep has fewer statements, and none of the others is lost."""
    sweep = PaperStatement("A small batch improves all.", True, "")
    ast, difs = (PaperStatement("It fails.", holds, "", subject=name) for holds, name in BOTH)
    full = PaperReproduction("full", 1, (), (sweep, ast, difs))
    learners = PaperReproduction("learners", 2, (), (ast, difs))
    judged = judge_over_seeds([full, learners])
    assert [(one.paper, one.subject, one.seeds) for one in judged] == [
        ("A small batch improves all.", "", 1),
        ("It fails.", "ast", 2),
        ("It fails.", "difs", 2),
    ]
    assert [one.verdict for one in judged] == ["holds", "holds", "does not hold"]
    assert count_asked(judged) == 3
    assert count_asked([judge(UNASKED), *judged]) == 3


BOTH = ((True, "ast"), (False, "difs"))
