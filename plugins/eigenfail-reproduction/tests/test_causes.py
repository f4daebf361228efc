"""The paper's statements on causes, and the tables behind them."""

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from sklearn.metrics import adjusted_rand_score

from eigenfail.values.analysis import AnalysisResult, FailureMode, InfluenceShare, Stability
from eigenfail.values.campaign import CampaignState
from eigenfail.values.estimates import Interval, Rate
from eigenfail.values.proof import Proof, ProvenScenario, Reproduction
from eigenfail.values.safety import FailurePoint, Figure, Safety, Scatter, SeverityRisk, Violations
from eigenfail.values.summary import Conflicts
from eigenfail_reproduction import tables
from eigenfail_reproduction.causes import compute_rand_index, judge_causes, leave_causes_open
from eigenfail_reproduction.programme import PROGRAMMES

NAME = "ast evaluation"
CUT_IN = msgspec.structs.replace(PROGRAMMES["cut_in"], step_s=0.1)
DRIVE = PROGRAMMES["highway_drive"]
SURE = Interval(0.9, 1.0)


def analysis(*explained, largest=(91, 95, 100), silhouette=0.6, modes=3):
    """What is looked at of an analysis of 30 failures; `largest` is the step, from 1 to 100, at
    which each component has its largest entry, a negative one."""
    nothing = np.zeros((0, 100, 2), np.float32)
    components = np.full((len(largest), 100, 2), 0.01, np.float32)
    for component, step in enumerate(largest):
        components[component, step - 1] = -0.5
    return AnalysisResult(
        episodes=tuple(range(30)),
        explained=np.array(explained, np.float32),
        components=components,
        scores=np.zeros((30, 0), np.float32),
        labels=(0,) * 30,
        modes=(FailureMode(0, 0, nothing, nothing),) * modes,
        influence=nothing,
        silhouette=silhouette,
        noise_silhouette=0.2,
        stability=Stability(20, 30, 0.9, SURE),
    )


def rate(k, n=4):
    return Rate(k / n, k, n, Interval(0.1, 0.9))


def proof(*failed_again):
    """A proof of 4 eigenfailures in each scenario; the first is the same one."""
    scenarios = tuple(
        ProvenScenario(
            scenario_parameters={"distance_m": 58.0 + 5.0 * place} if place else {},
            campaign=place + 1,
            state=CampaignState.DONE,
            eigenfailures=Reproduction(rate(k)),
            medoids=Reproduction(rate(4)),
            replays=(),
        )
        for place, k in enumerate(failed_again)
    )
    everywhere = Reproduction(rate(sum(failed_again), 4 * len(failed_again)))
    same = scenarios[0].eigenfailures
    return Proof(
        analysis=1,
        done=True,
        reproduced=same,
        eigenfailures=everywhere,
        medoids=everywhere,
        modes=(),
        scenarios=scenarios,
    )


def safety(correlation, low=-1.0, high=1.0, failures=30):
    """The safety measures of 300 episodes."""
    ttc = Violations(threshold=1.5, beyond=rate(19, 300), n=290, median=3.5, worst=0.1)
    return Safety(
        campaign=7,
        name=NAME,
        method="evaluate",
        completed=300,
        failures=rate(9, 300),
        collisions=rate(9, 300),
        near_misses=rate(10, 300),
        conflicts=Conflicts(),
        ttc=ttc,
        drac=ttc,
        severity=SeverityRisk(level=0.95, n=9, beyond=0.45),
        scatter=Scatter(
            tuple(FailurePoint(index, -2.0, 100.0, None) for index in range(failures)),
            failures,
            None if correlation is None else Figure(correlation, Interval(low, high)),
        ),
    )


COLLISION = ("longitudinal", "collision"), ("lateral", "collision")
ALONG = ("longitudinal", "collision"), ("longitudinal", "start")


def judge(words, *, proven=None, measured=None, given=None, readings=tuple(tables.READINGS)):
    """The statement with these words, where these readings have the given analysis."""
    usual = {"longitudinal": (0.2, 0.1, 0.1), "lateral": (0.5, 0.2, 0.1), "joint": (0.3, 0.1, 0.1)}
    analyses = {
        (NAME, *reading): given if given and reading in readings else analysis(*usual[reading[0]])
        for reading in tables.READINGS
    }
    proofs = {NAME: proven or proof(4, 4)}
    safeties = {NAME: measured or safety(-0.5, -0.7, -0.2)}
    found = judge_causes(analyses, proofs, safeties, CUT_IN, {})
    (one,) = [statement for statement in found if words in statement.paper]
    return one


def test_numbers_tell_what_each_choice_gives():
    largest = judge("just before", given=analysis(largest=(98, 71, 98)), readings=COLLISION[:1])
    told = "5 of 6 components (longitudinal 0.3, 3, 0.3 s; lateral 1, 0.6, 0.1 s before"
    assert told in largest.figures
    modes = judge("distinct failure modes", given=analysis(modes=2), readings=COLLISION[:1])
    assert "the collision: longitudinal 2, lateral 3, both axes 3; aligned" in modes.figures
    none = judge("distinct failure modes", given=analysis(silhouette=0.1), readings=COLLISION[1:])
    assert "lateral none distinct" in none.figures
    explained = judge("more components", given=analysis(0.9), readings=ALONG[1:])
    assert "aligned at the start: 90.0 % of the longitudinal variance, 80.0 %" in explained.figures
    assert explained.why.startswith("The choices that the paper leaves open")


INCLUDES_0 = "The interval includes 0."
BRAKES_LESS = "the planner brakes less."
FEWER_THAN_TEN = "There are fewer than ten failures."
ALL_ALIKE = "All failures have the same likelihood or the same severity."


@pytest.mark.parametrize(
    ("words", "given", "expected"),
    [
        ("more components", {}, True),
        ("more components", {"given": analysis(0.9, 0.05), "readings": ALONG}, False),
        ("more components", {"given": analysis(0.9, 0.05), "readings": ALONG[:1]}, None),
        ("more components", {"given": analysis(0.9, 0.05), "readings": ALONG[1:]}, None),
        ("just before the collision", {}, True),
        ("just before the collision", {"given": analysis(largest=(90, 50, 1))}, False),
        ("just before the collision", {"given": analysis(largest=(90, 50, 91))}, None),
        (
            "just before the collision",
            {"given": analysis(largest=(90, 50, 1)), "readings": COLLISION[:1]},
            None,
        ),
        ("just before the collision", {"given": analysis(largest=())}, None),
        ("distinct failure modes", {}, True),
        ("distinct failure modes", {"given": analysis(silhouette=0.1)}, False),
        ("distinct failure modes", {"given": analysis(modes=2)}, False),
        *(
            ("distinct failure modes", {"given": analysis(modes=2), "readings": (reading,)}, None)
            for reading in tables.READINGS
        ),
        ("reproduce failures in all", {}, True),
        ("reproduce failures in all", {"proven": proof(4, 3)}, False),
        ("rarer than minor", {}, True),
        ("rarer than minor", {"measured": safety(0.5, 0.2, 0.7)}, False),
        ("rarer than minor", {"measured": safety(0.1, -0.2, 0.4)}, None),
    ],
)
def test_a_statement_holds_fails_or_stays_open(words, given, expected):
    assert judge(words, **given).holds is expected


@pytest.mark.parametrize(
    ("measured", "numbers", "why"),
    [
        (safety(0.09825, -0.01543, 0.2094), "0.0983 [−0.0155, 0.210] over 30 failures", INCLUDES_0),
        (safety(-0.1, -0.4, 0.0), "−0.100 [−0.400, 0] over 30 failures", INCLUDES_0),
        (safety(-0.5, -0.7, -0.2), "−0.500 [−0.700, −0.200] over 30 failures", BRAKES_LESS),
        (safety(0.5, 0.2, 0.7), "0.500 [0.200, 0.700] over 30 failures", BRAKES_LESS),
        (safety(None, failures=9), "no rank correlation over 9 failures", FEWER_THAN_TEN),
        (safety(None, failures=10), "no rank correlation over 10 failures", ALL_ALIKE),
    ],
)
def test_a_rank_correlation_is_shown_with_its_interval_and_the_reason(measured, numbers, why):
    one = judge("rarer than minor", measured=measured)
    assert one.figures.startswith(f"{NAME}: ")
    assert numbers in one.figures
    assert "lies below 0" in one.rule
    assert why in one.why


def test_safety_measures_of_difs_stand_beside_the_papers():
    found = {"difs evaluation": safety(0.0, -1.0, 1.0), NAME: safety(0.0, -1.0, 1.0)}
    collision, ttc, _, *of_ast = tables.build_safety_table(found).rows
    assert (collision.numbers[0].value, collision.numbers[0].paper) == (0.03, 0.03)
    assert collision.numbers[1].value is None
    assert [number.paper for number in ttc.numbers] == [19 / 300, 3.50, 0.015]
    assert ttc.numbers[1].n == 290
    assert {number.paper for row in of_ast for number in row.numbers} == {None}, "it has none"


def test_modes_count_only_where_they_are_distinct():
    along, across = ((NAME, *reading) for reading in COLLISION)
    found = {along: analysis(0.2, 0.2), across: analysis(0.3), (NAME, *ALONG[1]): analysis(0.9)}
    table = tables.build_component_table(found, CUT_IN)
    assert [row.name for row in table.rows] == [f"{NAME}: longitudinal", f"{NAME}: lateral"]
    explained, modes = table.rows[0].numbers[:2]
    assert (explained.value, explained.paper) == (pytest.approx(0.4), 0.40)
    assert (modes.value, modes.paper) == (3.0, 3)
    assert table.rows[1].numbers[0].paper is None
    blob = tables.build_component_table({across: analysis(0.3, silhouette=0.1)}, CUT_IN)
    assert blob.rows[0].numbers[1].value == 1.0


def test_replays_are_told_by_scenario():
    rows = tables.build_replay_table({NAME: proof(4, 3)}, CUT_IN).rows
    assert [row.name for row in rows] == [
        f"{NAME}: the same scenario",
        f"{NAME}: distance_m 63",
    ]
    assert [row.numbers[0].value for row in rows] == [1.0, 0.75]
    told = judge("Eigenfailures reproduce", proven=proof(4, 3)).figures
    assert told.endswith(
        ": 7 of 8 replays collided, of 4 eigenfailures in `cut_in` with each distance_m of 58, 63"
    )


def drive(words, result, causes):
    """The statement with these words where the scenario names the causes of its failures."""
    analyses = {(NAME, *reading): result for reading in tables.list_readings(DRIVE)}
    found = judge_causes(analyses, {NAME: proof(4, 4)}, {}, DRIVE, {NAME: causes})
    (one,) = [statement for statement in found if words in statement.paper]
    return one


def keep_nine(result):
    """The analysis of fewer failures than are judged."""
    return msgspec.structs.replace(result, episodes=tuple(range(9)), labels=result.labels[:9])


def influenced(both, time=0.1):
    """An analysis in which the last second has these shares of the influence and of the time."""
    last = InfluenceShare(seconds=1.0, time=time, longitudinal=None, lateral=None, both=both)
    return msgspec.structs.replace(analysis(0.5), before_collision=(last,))


@pytest.mark.parametrize(
    ("result", "holds", "asked"),
    [
        (influenced(0.2), True, True),
        (influenced(0.19), False, True),
        (influenced(0.0), False, True),
        (influenced(None), None, False),
        (analysis(0.5), None, False),
        (keep_nine(influenced(0.5)), None, False),
    ],
)
def test_influence_just_before_the_collision_is_twice_that_of_other_times(result, holds, asked):
    one = drive("just before the collision", result, SAME)
    assert (one.holds, one.asked, one.subject) == (holds, asked, "ast")


LABELS = (0,) * 10 + (1,) * 10 + (2,) * 10
SAME = {episode: f"cause {label}" for episode, label in enumerate(LABELS)}
ONE_CAUSE = dict.fromkeys(range(30), "cut-in, track lost")


@pytest.mark.parametrize(
    ("changes", "causes", "holds"),
    [
        ({}, SAME, True),
        ({}, ONE_CAUSE, False),
        ({"modes": (FailureMode(0, 0, np.zeros(0), np.zeros(0)),) * 2}, SAME, False),
        ({"silhouette": 0.1}, SAME, False),
    ],
)
def test_modes_must_be_three_and_those_of_the_causes(changes, causes, holds):
    result = msgspec.structs.replace(analysis(0.5), **{"labels": LABELS, **changes})
    one = drive("distinct failure modes", result, causes)
    assert (one.holds, one.asked) == (holds, True)
    assert "adjusted Rand index with the causes" in one.figures


def test_causes_of_a_few_failures_are_not_asked_for():
    one = drive("distinct failure modes", keep_nine(analysis(0.5)), SAME)
    assert (one.holds, one.asked) == (None, False)


def test_a_drive_is_judged_aligned_at_the_collision_and_on_the_noise_of_all_vehicles():
    found = tables.list_readings(DRIVE)
    assert set(found) == {*COLLISION, ("joint", "collision"), ("joint", "start")}
    assert found["lateral", "collision"].axes == "every.lateral"
    assert found["joint", "start"].axes == "joint"
    one = drive("more components", analysis(0.9), SAME)
    assert "at the start" not in one.figures + one.rule


@given(
    st.lists(st.tuples(st.integers(0, 3), st.integers(0, 3)), min_size=1, max_size=25),
    st.permutations(range(4)),
)
def test_the_adjusted_rand_index_is_that_of_scikit_learn(pairs, names):
    first, second = zip(*pairs, strict=True)
    index = compute_rand_index(first, second)
    assert index == pytest.approx(adjusted_rand_score(first, second), abs=1e-12)
    assert compute_rand_index(first, [names[one] for one in first]) == 1.0


def test_the_adjusted_rand_index_of_a_crossed_table():
    """Two groups of two, crossed: no pair is together in both; 0 - 2/3 over 2 - 2/3."""
    assert compute_rand_index("aabb", "abab") == pytest.approx(-0.5)


def test_an_evaluation_without_a_failure_leaves_its_statements_unasked():
    found = [*leave_causes_open("ast_paper evaluation")]
    judged = {one.paper for one in judge_causes_of_all()}
    assert {one.paper for one in found} < judged
    assert {(one.holds, one.asked, one.subject) for one in found} == {(None, False, "ast_paper")}


def judge_causes_of_all():
    """All statements of one evaluation of the cut-in."""
    analyses = {(NAME, *reading): analysis(0.5) for reading in tables.READINGS}
    return judge_causes(analyses, {NAME: proof(4)}, {NAME: safety(0.5)}, CUT_IN, {})
