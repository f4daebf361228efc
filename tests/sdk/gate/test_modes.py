"""Failure modes that only the new planner has."""

from itertools import product
from math import comb

import numpy as np
import pytest
from example_values import NOTHING, make_findings

from eigenfail.gate.known import add_modes, bound_probability, find_new_modes, needs_modes
from eigenfail.gate.reruns import JudgedBy, Rerun, RerunFigures, RerunSide
from eigenfail.gate.verdicts import GateVerdict, RunOutcomes
from eigenfail.values.analysis import (
    Analysis,
    AnalysisSettings,
    AnalysisState,
    FailureMode,
)

BEFORE, NOW = 1, 2
SIDES = [
    RerunFigures(campaign=number, completed=1_000, failures=100, errored=0)
    for number in (BEFORE, NOW)
]


def together(before, now, silhouette=0.6, scores=None):
    """An analysis of the failures of two campaigns: how many of each are in which mode."""
    failures = [
        (campaign, mode)
        for campaign, counts in ((BEFORE, before), (NOW, now))
        for mode, count in enumerate(counts)
        for _ in range(count)
    ]
    centre = np.zeros(1, np.float32)
    return make_findings(
        episodes=tuple(range(100, 100 + len(failures))),
        scores=np.array(scores if scores is not None else [0.0] * len(failures))[:, None],
        labels=tuple(mode for _, mode in failures),
        campaigns=tuple(campaign for campaign, _ in failures),
        modes=tuple(FailureMode(1, 0, centre, NOTHING) for _ in before),
        silhouette=silhouette,
        noise_silhouette=0.3,
    )


def found(before, now, **changes):
    return [each.number for each in find_new_modes(together(before, now, **changes), *SIDES)]


def test_the_tail_is_that_of_drawing_without_replacement():
    for total, marked, drawn, k in product((5, 8), (0, 2, 5), (1, 4), (0, 1, 3)):
        ways = sum(comb(marked, x) * comb(total - marked, drawn - x) for x in range(k, drawn + 1))
        assert bound_probability(k, drawn, marked, total) == pytest.approx(
            ways / comb(total, drawn)
        )


def test_a_mode_in_which_the_baseline_had_no_failure_is_new():
    assert found((20, 20, 0), (20, 10, 10)) == [3]
    assert found((20, 0), (0, 20)) == [2]


def test_what_chance_explains_and_what_was_there_before_is_not_new():
    assert found((20, 20), (20, 20)) == []
    assert found((20, 0), (18, 2)) == []
    assert found((5, 5), (0, 40)) == []
    assert found((20, 20), (40, 0)) == []
    assert found((20, 0), (20, 0)) == []


def test_each_of_three_modes_is_tested_at_a_third_of_the_error():
    # By chance ours are all of 6 in the mode in 1.6 % of cases, and all of 7 in 0.8 %.
    assert found((20, 10, 0), (14, 10, 6)) == []
    assert found((20, 10, 0), (13, 10, 7)) == [3]


def test_a_mode_that_is_as_frequent_as_before_is_not_new_where_another_has_gone():
    assert found((95, 5), (0, 5)) == []
    assert found((95, 5), (0, 6)) == []
    assert found((95, 5), (0, 25)) == [2]


def test_a_stray_failure_of_the_baseline_does_not_hide_a_new_mode():
    assert found((59, 1), (30, 30)) == [2]
    assert found((50, 10), (30, 30)) == []


def test_the_episode_is_the_new_planners_nearest_to_the_centre():
    scores = [0.0] * 20 + [3.0] * 10 + [-0.5] + [2.0] * 9
    (mode,) = find_new_modes(together((20, 0), (0, 20), scores=scores), *SIDES)
    assert mode.episode == 130
    words = "new mode 2: 20 of 20 failures are in it, before 0 of 20"
    assert mode.words(judged=True).startswith(f"{words} (p = ")
    assert mode.words(judged=False) == words


def test_failures_of_one_kind_have_a_new_mode_as_seldom_as_is_told():
    random, alarms = np.random.default_rng(0), 0
    for _ in range(1_000):
        sides = random.choice(3, size=(2, 30), p=[0.45, 0.45, 0.1])
        counts = [np.bincount(side, minlength=3).tolist() for side in sides]
        alarms += bool(found(*counts))
    assert alarms <= 25


def test_failures_that_follow_each_other_have_one_far_more_often():
    random, alarms = np.random.default_rng(0), 0
    for _ in range(1_000):
        dwelt = random.choice(3, size=(2, 3), p=[0.45, 0.45, 0.1])
        counts = [np.bincount(side.repeat(10), minlength=3).tolist() for side in dwelt]
        alarms += bool(found(*counts))
    assert alarms > 170


@pytest.fixture
def judged(campaign, row):
    """A rerun by rate, the new planner's side, and an analysis of both."""

    def make(
        verdict=GateVerdict.STILL_FAILING, by=JudgedBy.RATE, before=20, now=20, method="monte_carlo"
    ):
        figures = [
            RerunFigures(campaign=number, completed=50, failures=failures, errored=0)
            for number, failures in ((BEFORE, before), (NOW, now))
        ]
        return Rerun(
            before=figures[0],
            now=figures[1],
            method=method,
            verdict=verdict,
            by=by,
            words="So be it.",
        )

    return make


@pytest.fixture
def side(campaign, row):
    rows = {index: row(index, campaign=NOW) for index in range(100, 200)}
    return RerunSide(campaign(NOW), RunOutcomes(50, rows, {}))


def analysis(result=None, problem=""):
    state = AnalysisState.DONE if result else AnalysisState.FAILED
    return Analysis(1, BEFORE, AnalysisSettings(campaigns=(NOW,)), state, 0, result, problem)


def test_modes_are_looked_at_only_where_they_would_change_the_verdict(judged):
    assert needs_modes(judged())
    assert needs_modes(judged(GateVerdict.FIXED))
    for verdict in (GateVerdict.NEW, GateVerdict.CANNOT_RUN, GateVerdict.SAFE):
        assert not needs_modes(judged(verdict))
    assert not needs_modes(judged(by=JudgedBy.EPISODE))
    assert not needs_modes(judged(before=0))
    assert not needs_modes(judged(GateVerdict.FIXED, now=0))


def test_a_new_mode_closes_with_its_replay(judged, side):
    told = add_modes(judged(), analysis(together((20, 0), (0, 20))), side, "http://here")
    assert told.verdict == "new"
    assert told.summary.startswith("So be it. New mode 2: 20 of 20 failures")
    (mode,) = told.new_modes
    assert mode.verdict == "new"
    assert mode.replay == "eigenfail episode replay 2/120"
    assert mode.link == "http://here/campaigns/2/episodes/120"


@pytest.mark.parametrize("method", ["ast", "difs", "cem", "replay"])
def test_where_failures_are_not_independent_a_new_mode_is_told_and_not_judged(judged, side, method):
    parted = analysis(together((20, 0), (0, 20)))
    told = add_modes(judged(method=method), parted, side, "http://here")
    assert told.verdict == "still failing"
    assert told.summary == (
        "So be it. New mode 2: 20 of 20 failures are in it, before 0 of 20. Reported, not"
        f" judged: failures of {method} are not independent of each other, so that two runs of one"
        " planner may dwell in different modes."
    )
    (mode,) = told.new_modes
    assert (mode.verdict, mode.replay) == ("unproven", "eigenfail episode replay 2/120")


def test_without_a_new_mode_or_without_modes_the_verdict_stays(judged, side):
    for result, words in (
        (together((20, 20), (20, 20)), "None of 2 failure modes is new."),
        (together((20, 0), (0, 20), silhouette=0.1), "cannot be decided: No distinct modes"),
    ):
        told = add_modes(judged(), analysis(result), side, "")
        assert (told.verdict, told.new_modes) == ("still failing", ())
        assert words in told.summary
    broken = add_modes(judged(), analysis(problem="It broke off."), side, "")
    assert broken.summary.endswith("cannot be decided: It broke off.")
