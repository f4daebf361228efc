"""The answer: units, shares, verdicts, classes of severity, and what is missing."""

import pytest
from msgspec.structs import replace

from eigenfail.risk.assessment import RiskVerdict, ScenarioEvidence, assess, name_noises
from eigenfail.risk.confidence import FailureShare
from eigenfail.risk.question import Driving, RiskQuestion, RiskScenario, RiskTarget
from eigenfail.risk.sentences import describe_assessment, describe_verdict
from eigenfail.values import Interval

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
