"""The answer: units, shares, verdicts, classes of severity, and what is missing."""

import pytest
from msgspec.structs import replace

from eigenfail.values.estimates import Interval
from eigenfail_assurance.risk.assessment import RiskVerdict, ScenarioEvidence, assess, name_noises
from eigenfail_assurance.risk.confidence import FailureShare, RunEstimate, Stated
from eigenfail_assurance.risk.question import Driving, RiskQuestion, RiskScenario, RiskTarget
from eigenfail_assurance.risk.sentences import (
    NO_CLASS_BOUNDED,
    NONE_OBSERVED,
    describe_assessment,
    describe_verdict,
    list_tables,
)

SCENARIOS = (
    RiskScenario(name="a", encounters=400, campaigns=(1,)),
    RiskScenario(name="b", per_kilometre=0.01, interval=(0.005, 0.02), campaigns=(2,)),
)
QUESTION = RiskQuestion(
    name="motorway",
    target=RiskTarget(per_hour=0.05),
    exposure=Driving(hours=1_000.0, kilometres=50_000.0),
    scenarios=SCENARIOS,
    severity=(10.0, 50.0),
)


def make_evidence(k, n=1_000, **fields):
    known = FailureShare(k, 0, n, k / n)
    whole = {"episodes": n, "failures": k, "probability": known, "seeds": (k,), **fields}
    return ScenarioEvidence(**whole)


MISSING = ScenarioEvidence(problem="it was lost.")


def test_rates_have_their_units():
    found = assess(QUESTION, [make_evidence(10), make_evidence(20)])
    a, b = found.scenarios
    assert a.encounters_per_hour.value == pytest.approx(0.4)
    assert b.encounters_per_hour.value == pytest.approx(0.5)
    ends = b.encounters_per_hour.interval
    assert (ends.low, ends.high) == pytest.approx((0.25, 1.0), rel=1e-3)
    assert found.per_hour.value == pytest.approx(0.4 * 0.01 + 0.5 * 0.02)
    assert found.per_million_km.value == pytest.approx(found.per_hour.value / 50.0 * 1e6)
    assert a.share == pytest.approx(4.0 / 14.0)
    assert a.share + b.share == pytest.approx(1.0)
    assert found.per_hour.interval.low < found.per_hour.at_least < found.per_hour.value
    assert found.per_hour.value < found.per_hour.at_most < found.per_hour.interval.high


@pytest.mark.parametrize(
    ("target", "verdict"),
    [
        (RiskTarget(per_hour=0.05), RiskVerdict.MET),
        (RiskTarget(per_hour=0.014), RiskVerdict.UNDECIDED),
        (RiskTarget(per_hour=0.001), RiskVerdict.NOT_MET),
        (RiskTarget(per_million_km=1_000.0), RiskVerdict.MET),
        (RiskTarget(per_million_km=20.0), RiskVerdict.NOT_MET),
    ],
)
def test_the_verdict_is_that_of_one_sided_bounds(target, verdict):
    question = replace(QUESTION, target=target)
    found = assess(question, [make_evidence(10), make_evidence(20)])
    assert found.verdict is verdict
    assert f": {verdict}." in describe_verdict(found)


def test_the_target_is_met_at_the_bound_itself():
    found = assess(QUESTION, [make_evidence(10), make_evidence(20)])
    exactly = replace(QUESTION, target=RiskTarget(per_hour=found.per_hour.at_most))
    assert assess(exactly, [make_evidence(10), make_evidence(20)]).verdict is RiskVerdict.MET


@pytest.mark.parametrize("target", [1e-9, 1e9])
def test_without_an_estimate_the_target_may_be_missed_but_not_met(target):
    question = replace(QUESTION, target=RiskTarget(per_hour=target))
    found = assess(question, [make_evidence(10), MISSING])
    is_above = target < 1.0
    assert found.verdict is (RiskVerdict.NOT_MET if is_above else RiskVerdict.UNDECIDED)
    assert found.per_hour.value is found.per_hour.at_most is found.per_hour.interval is None
    assert found.per_million_km.value is None
    alone = assess(replace(question, scenarios=SCENARIOS[:1]), [make_evidence(10)])
    assert found.per_hour.at_least == alone.per_hour.at_least > 0.0
    assert [each.share for each in found.scenarios] == [None, None]
    assert found.severity == ()
    text = describe_verdict(found)
    assert ("cannot be judged without an estimate for 'b'" in text) is not is_above
    assert ("That is without 'b', of which there is no estimate" in text) is is_above


def test_nothing_failed_anywhere():
    found = assess(QUESTION, [make_evidence(0), make_evidence(0)])
    assert found.per_hour.value == found.per_hour.at_least == 0.0
    assert found.per_hour.at_most > 0.0
    assert found.verdict is RiskVerdict.MET
    assert [each.share for each in found.scenarios] == [None, None]
    totals, *_ = list_tables(found)
    assert [row[1].value for row in totals.cells] == [NONE_OBSERVED, NONE_OBSERVED]


@pytest.mark.parametrize("target", [0.05, 1e-6])
def test_the_verdict_without_a_failure_begins_with_the_bound(target):
    question = replace(QUESTION, target=RiskTarget(per_hour=target))
    found = assess(question, [make_evidence(0), make_evidence(0)])
    is_met = target > 1e-3
    assert found.verdict is (RiskVerdict.MET if is_met else RiskVerdict.UNDECIDED)
    said = describe_verdict(found)
    assert said.startswith("Failures are at most ")
    assert float(said.split()[4]) == pytest.approx(found.per_hour.at_most, rel=0.01)
    assert "none was observed" in said
    assert f"motorway: {found.verdict}." in said


def test_classes_of_severity_are_weighed_by_the_scenarios_rates():
    first = make_evidence(10, severities=(5.0, 20.0, 20.0, 50.0), sampled_failures=5)
    found = assess(QUESTION, [first, make_evidence(20)])
    rates = {each.name: each.per_hour for each in found.severity}
    assert rates == pytest.approx(
        {
            "below 10": 0.004 / 5,
            "10 to 50": 0.004 * 2 / 5,
            "50 or more": 0.004 / 5,
            "no collision": 0.004 / 5,
            "not known": 0.01,
        }
    )
    assert sum(each.share for each in found.severity) == pytest.approx(1.0)
    assert [each.counted for each in found.severity] == [1, 2, 1, 1, 0]


def classify(*evidence, thresholds=(10.0,), rate=2.0):
    """The classes of scenarios that are met at an exactly known rate, and the total."""
    scenarios = tuple(
        RiskScenario(name=f"{place}", per_hour=rate, campaigns=(place + 1,))
        for place in range(len(evidence))
    )
    found = assess(replace(QUESTION, scenarios=scenarios, severity=thresholds), evidence)
    return {each.name: each for each in found.severity}, found


@pytest.mark.parametrize("n", [100, 3_000])
def test_the_bound_of_a_class_without_a_failure_has_a_closed_form(n):
    mild = make_evidence(13, n, severities=(5.0,) * 13, sampled_failures=13, are_counted=True)
    classes, found = classify(mild)
    severe = classes["10 or more"]
    # 1 - 0.05^(1/n) is the exact bound of no event in n.
    assert severe.at_most == pytest.approx(2.0 * (1.0 - 0.05 ** (1.0 / n)), rel=1e-3)
    assert (severe.per_hour, severe.counted) == (0.0, 0)
    # All failures are in the other class.
    assert classes["below 10"].at_most == found.per_hour.at_most
    *_, table = list_tables(found)
    assert table.cells[1][1].value == NONE_OBSERVED
    assert "0 %" not in [cell.value for cell in table.cells[1]]


def test_errored_episodes_may_have_failed_in_any_class():
    known = FailureShare(2, 3, 500, 2 / 497)
    sample = {"severities": (5.0, 5.0), "sampled_failures": 2, "are_counted": True}
    errored = make_evidence(2, 500, **{"probability": known, **sample})
    classes, _ = classify(errored)
    seen = make_evidence(3, 500, severities=(20.0,) * 3, sampled_failures=3, are_counted=True)
    assert classes["10 or more"].at_most == classify(seen)[0]["10 or more"].at_most


def test_classes_are_bounded_by_the_total_and_sums_cover_all_scenarios():
    one = make_evidence(3, severities=(5.0, 20.0, 90.0), sampled_failures=3, are_counted=True)
    other = make_evidence(1, severities=(60.0,), sampled_failures=1, are_counted=True, seeds=(9,))
    classes, found = classify(one, other, thresholds=(10.0, 50.0))
    alone, _ = classify(one, thresholds=(10.0, 50.0))
    for name, each in classes.items():
        assert each.per_hour < each.at_most <= found.per_hour.at_most
        assert each.at_most > alone[name].at_most


@pytest.mark.parametrize(
    "unbounded",
    [
        make_evidence(2, severities=(5.0, 5.0), sampled_failures=2),
        make_evidence(
            2,
            probability=RunEstimate(1e-3, 0.3, 5.0),
            severities=(5.0, 5.0),
            sampled_failures=2,
        ),
        make_evidence(2, probability=Stated(2e-3, 1e-4, 1e-2)),
    ],
)
def test_other_evidence_bounds_no_class(unbounded):
    counted = make_evidence(1, severities=(60.0,), sampled_failures=1, are_counted=True, seeds=(9,))
    classes, found = classify(counted, unbounded)
    assert {each.at_most for each in classes.values()} == {None}
    *_, table = list_tables(found)
    assert NO_CLASS_BOUNDED in table.notes


def test_an_exactly_known_exposure_has_no_interval_and_is_told():
    known = RiskScenario(name="c", per_hour=2.0, campaigns=(3,))
    found = assess(replace(QUESTION, scenarios=(known,)), [make_evidence(10)])
    assert found.scenarios[0].encounters_per_hour.interval is None
    assert isinstance(found.scenarios[0].probability.interval, Interval)
    said = " ".join(each for each in describe_assessment(found) if isinstance(each, str))
    assert "Encounters with 'c' are taken to be known exactly" in said


@pytest.mark.parametrize("bound", ["at_least", "at_most"])
def test_a_bound_next_to_the_target_is_printed_on_its_side_of_it(bound):
    evidence = [make_evidence(10), make_evidence(20)]
    value = getattr(assess(QUESTION, evidence).per_hour, bound)
    is_above = bound == "at_least"
    target = float(f"{value * (1.0 - 1e-6 if is_above else 1.0 + 1e-6):.9g}")
    question = replace(QUESTION, target=RiskTarget(per_hour=target))
    found = assess(question, evidence)
    assert found.verdict is (RiskVerdict.NOT_MET if is_above else RiskVerdict.MET)
    words = describe_verdict(found).replace(",", "").split()
    printed, told = (float(each) for each in words if each[0].isdigit())
    assert told == target
    assert printed > told if is_above else printed <= told


def test_scenarios_with_a_common_seed_have_one_noise():
    one, two, three, other = name_noises([(1, 2), (3, 4), (2, 3), (5,)])
    assert one == two == three != other
    assert name_noises([(7,), (7, 3)]) == ["seed 3", "seed 3"]


def test_without_a_distance_there_is_no_rate_by_distance():
    known = RiskScenario(name="c", per_hour=2.0, campaigns=(3,))
    question = replace(QUESTION, scenarios=(known,), exposure=Driving(hours=10.0))
    assert assess(question, [make_evidence(10)]).per_million_km is None
