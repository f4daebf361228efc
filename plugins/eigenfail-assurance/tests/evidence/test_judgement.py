"""Verdicts on solutions: what bounds, counts, replays, gates and sensors show."""

import pytest
from msgspec.structs import replace

from eigenfail.gate.report import GateRun, MemberReport, build_report
from eigenfail.gate.reruns import GateFinding, RerunFigures
from eigenfail.gate.verdicts import GateVerdict
from eigenfail.values.campaign import CampaignState
from eigenfail.values.campaign_spec import StopRules
from eigenfail.values.estimates import Estimate, Interval
from eigenfail.values.proof import Proof, ProvenScenario, ReplayedNoise, ReplayKind, Reproduction
from eigenfail_assurance.evidence.judgement import judge_solution
from eigenfail_assurance.evidence.question import (
    GateSolution,
    ProbabilitySolution,
    ReplaySolution,
    RiskSolution,
    SearchSolution,
    SensorSolution,
)
from eigenfail_assurance.evidence.records import SolutionInput
from eigenfail_assurance.risk.question import Driving, RiskQuestion, RiskScenario, RiskTarget
from eigenfail_assurance.sensor import search
from eigenfail_assurance.sensor.anchors import bound_sampled, judge_bounds


def judge_probability(count, *records, at_most=0.05, confidence=0.95):
    given, counted = count(*records)
    solution = ProbabilitySolution(campaigns=(1,), at_most=at_most, confidence=confidence)
    return judge_solution(solution, given, counted)


@pytest.mark.parametrize("confidence", [0.5, 0.95, 0.999])
def test_without_a_failure_the_bound_has_a_closed_form(make, count, confidence):
    found = judge_probability(count, make("s" * 100), confidence=confidence)
    exact = 1.0 - (1.0 - confidence) ** (1 / 100)
    assert found.figures["at_most"] == pytest.approx(exact, rel=1e-9)
    assert found.figures["at_least"] == 0.0


@pytest.mark.parametrize(
    ("outcomes", "verdict"),
    [("s" * 59, "supported"), ("s" * 58, "undecided"), ("c" * 9 + "s" * 40, "refuted")],
)
def test_the_bound_decides(make, count, outcomes, verdict):
    # 0.95^n is 0.05 between 58 and 59.
    assert judge_probability(count, make(outcomes)).verdict == verdict


def test_errored_episodes_count_as_failures_in_the_upper_bound_alone(make, count):
    failed = judge_probability(count, make("c" + "s" * 98 + "c"))
    errored = judge_probability(count, make("c" + "s" * 98 + "e"))
    assert errored.figures["at_most"] == failed.figures["at_most"]
    assert errored.figures["at_least"] < failed.figures["at_least"]


def test_unresolved_episodes_count_as_failures_in_the_upper_bound_alone(make, count):
    failed = judge_probability(count, make("c" + "s" * 98 + "c"))
    unresolved = judge_probability(count, make("c" + "s" * 99, unresolved=1))
    assert unresolved.figures["at_most"] == failed.figures["at_most"]
    assert unresolved.figures["at_least"] < failed.figures["at_least"]
    assert unresolved.figures["probability"] == 0.01
    assert unresolved.figures["unresolved"] == 1
    # 59 safe episodes support it, unless one of them is unresolved.
    assert judge_probability(count, make("s" * 59, unresolved=1)).verdict == "undecided"
    parts = make("cs", 1, unresolved=1), make("sss", 2, seed=4, unresolved=2)
    whole = make("cssss", unresolved=3)
    assert judge_probability(count, *parts).figures == judge_probability(count, whole).figures


def test_campaigns_of_monte_carlo_are_counted_together(make, count):
    parts = judge_probability(count, make("css", 1), make("csssss", 2, seed=4))
    whole = judge_probability(count, make("ccsssssss"))
    assert parts.figures == whole.figures


@pytest.mark.parametrize(
    "record",
    [
        ("s" * 99, {"method": "ast"}),
        ("s" * 99, {"method": "replay"}),
        ("s" * 99, {"method": "subset"}),
        ("s" * 99, {"state": "cancelled"}),
        ("e" * 99, {}),
        ("s" * 99, {"stop": StopRules(half_width=0.1)}),
    ],
)
def test_what_states_no_probability_leaves_it_undecided(make, count, record):
    outcomes, fields = record
    found = judge_probability(count, make(outcomes, **fields))
    assert (found.verdict, found.figures) == ("undecided", {})
    assert found.words.startswith("No probability is known: ")


def test_a_stop_rule_that_ended_the_campaign_leaves_a_lower_bound(make, count):
    found = judge_probability(count, make("c" * 20, stop=StopRules(failures=20)), at_most=0.5)
    assert (found.verdict, found.figures["at_most"]) == ("refuted", 1.0)
    assert found.figures["probability"] is None


def test_an_estimate_has_its_own_bounds(make, count):
    estimate = Estimate(
        by="subset simulation",
        episodes=10,
        probability=1e-4,
        cv=0.3,
        interval=Interval(5.6247e-5, 1.7779e-4),
    )
    found = judge_probability(
        count, make("cs" * 5, method="subset", estimate=estimate), at_most=2e-4
    )
    assert found.verdict == "supported"
    assert 1e-4 < found.figures["at_most"] < 1.7779e-4
    assert found.figures["probability"] == 1e-4
    bare = replace(estimate, interval=None, bound="lower")
    low = judge_probability(count, make("cs" * 5, method="mixture", estimate=bare))
    assert low.verdict == "undecided"


@pytest.mark.parametrize(
    ("record", "wanted", "verdict"),
    [
        (("ssss", {}), {}, "supported"),
        (("sscs", {}), {}, "refuted"),
        (("sscs", {}), {"failures_at_most": 1}, "supported"),
        (("sses", {}), {}, "undecided"),
        (("scce", {}), {"failures_at_most": 1}, "refuted"),
        (("ssss", {}), {"episodes_at_least": 5}, "undecided"),
        (("ssss", {"state": "cancelled"}), {}, "undecided"),
        (("sscs", {"state": "cancelled"}), {}, "refuted"),
    ],
)
def test_a_search_is_judged_by_its_count(make, count, record, wanted, verdict):
    outcomes, fields = record
    given, counted = count(make(outcomes, method="ast", **fields))
    solution = SearchSolution(campaigns=(1,), **wanted)
    assert judge_solution(solution, given, counted).verdict == verdict


def ask_risk(target, *scenarios):
    return RiskSolution(
        question=RiskQuestion(
            name="Road",
            target=RiskTarget(per_hour=target),
            exposure=Driving(hours=10.0),
            scenarios=tuple(
                RiskScenario(name=name, per_hour=1.0, campaigns=(name,)) for name in scenarios
            ),
        )
    )


@pytest.mark.parametrize(
    ("target", "verdict"), [(0.9, "supported"), (1e-6, "refuted"), (0.06, "undecided")]
)
def test_a_risk_is_judged_by_its_target(make, count, target, verdict):
    given, counted = count(make("c" * 5 + "s" * 95))
    assert judge_solution(ask_risk(target, "one"), given, counted).verdict == verdict


def test_unresolved_episodes_count_in_the_upper_bound_of_a_risk(make, count):
    _, counted = count(make("c" * 5 + "s" * 95, 1, unresolved=3))
    _, as_failures = count(make("c" * 8 + "s" * 92, 1))
    given = SolutionInput(campaigns=((1,),))
    found, other = (
        judge_solution(ask_risk(0.1, "one"), given, each).figures for each in (counted, as_failures)
    )
    assert found["at_most_per_hour"] == other["at_most_per_hour"]
    assert found["at_least_per_hour"] < other["at_least_per_hour"]
    assert found["per_hour"] == pytest.approx(0.05)


def test_a_search_has_no_part_in_a_risk(make, count):
    _, counted = count(make("s" * 99, 1), make("s" * 99, 2, method="ast"))
    given = SolutionInput(campaigns=((1,), (2,)))
    assert judge_solution(ask_risk(1.0, "one", "two"), given, counted).verdict == "undecided"


def prove(*outcomes, done=True):
    replays = tuple(
        ReplayedNoise(what=ReplayKind.EIGENFAILURE, mode=mode, campaign=1, index=mode)
        for mode, _ in enumerate(outcomes)
    )
    scenario = ProvenScenario(
        scenario_parameters={},
        campaign=1,
        state=CampaignState.DONE,
        eigenfailures=Reproduction(),
        medoids=Reproduction(),
        replays=replays,
    )
    return Proof(
        analysis=7,
        done=done,
        reproduced=Reproduction(),
        eigenfailures=Reproduction(),
        medoids=Reproduction(),
        modes=(),
        scenarios=(scenario,),
    )


@pytest.mark.parametrize(
    ("outcomes", "least", "verdict"),
    [
        ("cccc", 1.0, "supported"),
        ("cccs", 1.0, "refuted"),
        ("cccs", 0.75, "supported"),
        ("ccce", 0.5, "undecided"),
    ],
)
def test_replays_are_counted_in_the_episodes(make, count, outcomes, least, verdict):
    given, counted = count(make(outcomes, method="replay"))
    given = replace(given, proof=prove(*outcomes))
    solution = ReplaySolution(campaign=1, reproduced_at_least=least)
    assert judge_solution(solution, given, counted).verdict == verdict
    late = replace(given, proof=prove(*outcomes, done=False))
    assert judge_solution(solution, late, counted).verdict == "undecided"


def make_gate(verdict, episode, baseline="v1"):
    finding = GateFinding(verdict=verdict, what="mode 1", episode=episode)
    side = RerunFigures(campaign=1, completed=1, failures=0, errored=0)
    member = MemberReport(member="cut-in", baseline=side, known=(finding,))
    return build_report(GateRun(suite="s", version="", run="s", baseline=baseline), [member])


@pytest.mark.parametrize(
    ("report", "verdict"),
    [
        (make_gate(GateVerdict.FIXED, "1/0"), "supported"),
        (make_gate(GateVerdict.NEW, "1/1"), "refuted"),
        (make_gate(GateVerdict.FIXED, "1/1"), "undecided"),
        (make_gate(GateVerdict.FIXED, "1/9"), "undecided"),
        (make_gate(GateVerdict.FIXED, "1/0", baseline=""), "undecided"),
        (make_gate(GateVerdict.FIXED, ""), "undecided"),
        (replace(make_gate(GateVerdict.NEW, "1/1"), open=True), "undecided"),
    ],
)
def test_a_gate_is_compared_with_its_episodes(make, count, report, verdict):
    given, counted = count(make("sc"))
    assert judge_solution(GateSolution(report=report), given, counted).verdict == verdict


def answer_sensor(records, question):
    anchors = []
    for size, record in records.items():
        counts, bounds = record.campaign.counts, bound_sampled(record.campaign, question.test_error)
        anchors.append(
            search.Anchor(
                multiples={"scale": size},
                campaign=record.campaign.id,
                episodes=counts.completed,
                failures=counts.failures,
                probability=None,
                bounds=bounds,
                verdict=judge_bounds(bounds, question.target),
            )
        )
    limit = search.ErrorLimit(
        channel="scale",
        beside={},
        largest=None,
        not_met_from=None,
        undecided=(),
        at_high_end=False,
        tests=tuple(records),
    )
    return search.RequirementAnswer(
        question=question,
        limits=(limit,),
        frontier=(),
        anchors=tuple(anchors),
        contradictions=(),
    )


@pytest.mark.parametrize(
    ("wanted", "verdict"),
    [(0.9, "supported"), (1.0, "supported"), (1.5, "undecided"), (2.0, "refuted")],
)
def test_a_sensor_is_judged_by_the_bounds_of_its_anchors(make, count, wanted, verdict):
    question = search.RequirementQuestion(target=0.1)
    records = {1.0: make("s" * 200, 1), 2.0: make("c" * 50 + "s" * 50, 2)}
    given, counted = count(*records.values())
    answer = answer_sensor(records, question)
    solution = SensorSolution(answer=answer, channel="scale", multiple=wanted)
    assert judge_solution(solution, given, counted).verdict == verdict
    wrong = replace(answer.anchors[0], bounds=Interval(0.0, 0.01))
    other = replace(solution, answer=replace(answer, anchors=(wrong, *answer.anchors[1:])))
    assert judge_solution(other, given, counted).verdict == "undecided"


def test_what_could_not_be_read_leaves_it_undecided(make, count):
    given, counted = count(make("ssss"))
    given = replace(given, missing=("There is no analysis.",))
    found = judge_solution(ReplaySolution(campaign=1), given, counted)
    assert (found.verdict, found.words) == ("undecided", "There is no analysis.")
