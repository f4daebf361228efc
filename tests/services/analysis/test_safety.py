"""The safety table: the paper's own numbers, and what it says where it knows little."""

import numpy as np
import pytest
from made_campaigns import make_campaign
from msgspec.structs import replace

from eigenfail.presentation.campaigns import describe_safety
from eigenfail.values.campaign import Campaign, Counts
from eigenfail.values.records import ConflictClass
from eigenfail.values.safety import FailurePoint, MeasureTotals, SafetyTotals
from eigenfail.values.summary import Conflicts, MeanTime, Unresolved
from eigenfail_services.analysis.campaign_figures import make_safety
from eigenfail_services.statistics.intervals import rate

PAPER = Conflicts(4, 5, 0, 10, MeanTime(2.24, 9), MeanTime(0.23, 4))
NOBODY = Unresolved()


def campaign(method: str = "difs") -> Campaign:
    return make_campaign(Counts(300, 300, 9), method)


def totals(severities=(), points=(), failures=9) -> SafetyTotals:
    return SafetyTotals(
        completed=300,
        failures=failures,
        ttc=MeasureTotals(300, 19, 3.5, 0.015),
        drac=MeasureTotals(300, 4, 0.4, 43.633),
        severities=np.array(severities, np.float64),
        points=tuple(points),
    )


def point(index: int) -> FailurePoint:
    return FailurePoint(index, -2.0 - index, 100.0 + index, ConflictClass.PLANNER_FAILURE)


@pytest.mark.parametrize(
    ("method", "independent"),
    [("monte_carlo", True), ("held", True), ("evaluate", True)]
    + [(method, False) for method in ("ast", "difs", "cem", "subset", "ensemble", "replay")],
)
def test_only_over_independent_episodes_have_figures_an_interval(
    method: str, independent: bool
) -> None:
    severities = np.random.default_rng(1).exponential(30.0, 500)
    given = totals(severities, [point(index) for index in range(40)], 500)
    found = make_safety(campaign(method), given, PAPER, NOBODY)
    risk = found.severity
    figures = (risk.mean, risk.var, risk.cvar, found.scatter.rank_correlation)
    assert [each is not None and each.value != 0.0 for each in figures] == [True] * 4
    assert [each.interval is not None for each in figures if each] == [independent] * 4
    assert any("have no interval" in note for note in found.notes) is not independent
    few = make_safety(campaign(method), totals([1.0] * 9, failures=9), PAPER, NOBODY).severity
    assert few.cvar is None
    assert few.problem


def test_the_paper_s_table() -> None:
    of_chance = campaign("monte_carlo")
    found = make_safety(of_chance, totals([100.0] * 9, map(point, range(9))), PAPER, NOBODY)
    assert (found.campaign, found.name, found.completed) == (7, "truck", 300)
    assert found.collisions == rate(9, 300)
    assert found.near_misses == rate(10, 300)
    assert found.ttc.beyond == rate(19, 300)
    assert (found.ttc.threshold, found.ttc.median, found.ttc.worst) == (1.5, 3.5, 0.015)
    assert found.drac.beyond == rate(4, 300)
    assert (found.drac.threshold, found.drac.median, found.drac.worst) == (7.0, 0.4, 43.633)
    assert found.conflicts == PAPER
    assert found.severity.mean.value == 100.0
    assert found.severity.cvar is None
    assert "9 failures leave 0.45" in found.severity.problem


def test_failures_that_a_search_chose_are_said_to_be_chosen() -> None:
    chosen = make_safety(campaign(), totals([1.0] * 9, map(point, range(9))), PAPER, NOBODY).notes
    drawn = make_safety(
        campaign("monte_carlo"), totals([1.0] * 9, map(point, range(9))), PAPER, Unresolved()
    ).notes
    assert "those that difs chose" in " ".join(chosen)
    found = make_safety(campaign(), totals(), PAPER, NOBODY)
    shares = (found.collisions, found.near_misses, found.ttc.beyond, found.drac.beyond)
    assert [(share.k, share.sampled) for share in shares] == [(n, False) for n in (9, 10, 19, 4)]
    assert drawn == ()


def test_what_is_left_out_is_said() -> None:
    found = make_safety(
        campaign("monte_carlo"), totals([1.0] * 7, map(point, range(4))), PAPER, Unresolved()
    )
    assert found.scatter.of == 7
    assert found.notes == (
        "2 of 9 failures have no severity and are left out of it.",
        "The scatter shows 4 of 7 failures, evenly spread in index order.",
    )


def test_severe_failures_that_are_rarer_show() -> None:
    found = make_safety(campaign(), totals([1.0] * 12, map(point, range(12)), 12), PAPER, NOBODY)
    assert found.scatter.rank_correlation.value == pytest.approx(-1.0)


def test_before_the_first_episode_nothing_is_known() -> None:
    nothing = SafetyTotals(0, 0, MeasureTotals(), MeasureTotals(), np.zeros(0), ())
    found = make_safety(campaign(), nothing, Conflicts(), NOBODY)
    assert found.collisions is found.near_misses is found.ttc.beyond is found.drac.median is None
    assert found.severity.problem == "There is no failure."
    assert found.notes == ()


def test_who_ended_before_a_collision_is_said_first() -> None:
    ended = Unresolved(5, 10.0)
    found = make_safety(campaign("monte_carlo"), totals(failures=0), Conflicts(), ended)
    assert found.unresolved == ended
    (words,) = found.notes
    assert words.startswith("5 of 300 had no collision within 10 s, but ended while braking")


def on_function(method: str = "monte_carlo") -> Campaign:
    function = {"simulator": "function", "scenario": "function", "planner": "my_module:robustness"}
    return make_campaign(
        Counts(300, 300, 9), method, spec={**function, "scenario_parameters": {"steps": 4}}
    )


def test_of_a_function_only_the_failures_are_counted() -> None:
    given = SafetyTotals(300, 9, MeasureTotals(), MeasureTotals(), np.zeros(0), ())
    found = make_safety(on_function(), given, Conflicts(unclassified=9), NOBODY)
    assert found.collisions == rate(9, 300)
    assert found.near_misses is found.ttc.beyond is found.drac.beyond is None
    assert not found.measures_traffic
    assert found.severity.problem == "Severity is not measured for a function."
    assert found.notes == (
        "Near misses, MinTTC, DRAC and conflict classes are not measured for a function.",
    )
    chosen = make_safety(on_function("cem"), given, Conflicts(unclassified=9), NOBODY).notes
    assert chosen[0] == (
        "The episodes are those that cem chose: the share of failures is of these, not of what "
        "p(x) would bring, and has no interval."
    )


def test_failures_without_a_severity_are_failures() -> None:
    found = make_safety(campaign("monte_carlo"), totals(), PAPER, Unresolved())
    assert found.measures_traffic
    assert found.severity.problem == "No failure has a severity."


def test_a_terminal_shows_nothing_of_a_function_that_was_not_measured() -> None:
    given = SafetyTotals(300, 9, MeasureTotals(), MeasureTotals(), np.zeros(0), ())
    found = make_safety(on_function(), given, Conflicts(unclassified=9), NOBODY)
    heading, table, _, *notes = describe_safety(found)
    assert heading == "Safety measures of campaign 7, truck (monte_carlo): 300 episodes"
    assert [row[0] for row in table.rows] == ["Failure"]
    assert notes == [found.severity.problem, *found.notes]


def test_row_of_collisions_counts_those_that_no_requirement_forbids() -> None:
    allowing = replace(PAPER, unavoidable=0, planner_failures=0, unclassified=0, allowed=10)
    found = make_safety(campaign("monte_carlo"), totals([], failures=0), allowing, Unresolved())
    assert found.collisions == rate(10, 300)
    assert any(note.startswith("10 of the collisions are no failures") for note in found.notes)
