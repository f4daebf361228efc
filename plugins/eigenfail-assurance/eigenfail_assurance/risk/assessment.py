"""The answer: failures in an hour of driving with their bounds, by scenario and by severity."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from enum import StrEnum
from itertools import pairwise

import msgspec

from eigenfail.values.estimates import Interval
from eigenfail_assurance.risk import confidence
from eigenfail_assurance.risk.allocation import Allocation, allocate_episodes
from eigenfail_assurance.risk.question import KM_PER_FIGURE, RiskQuestion, RiskScenario


class RiskVerdict(StrEnum):
    """The verdict of the bounds on the target."""

    MET = "met"
    NOT_MET = "not met"
    UNDECIDED = "undecided"


class RiskFigure(msgspec.Struct, frozen=True, kw_only=True):
    """A number with its uncertainty.

    Attributes:
        value: point estimate; None if there is none.
        interval: two-sided interval of 95 %; None if the number is not bounded above.
        at_least: one-sided lower bound of 95 %; None of factors, which are not judged.
        at_most: one-sided upper bound of 95 %; None if there is none.
    """

    value: float | None
    interval: Interval | None = None
    at_least: float | None = None
    at_most: float | None = None

    def scale(self, factor: float) -> "RiskFigure":
        """Return the figure in another unit."""

        def convert(value: float | None) -> float | None:
            return None if value is None else factor * value

        ends = self.interval
        return RiskFigure(
            value=convert(self.value),
            interval=None if ends is None else Interval(factor * ends.low, factor * ends.high),
            at_least=convert(self.at_least),
            at_most=convert(self.at_most),
        )


NOTHING_KNOWN = RiskFigure(value=None)


class ScenarioEvidence(msgspec.Struct, frozen=True, kw_only=True):
    """The evidence of campaigns on a scenario.

    Attributes:
        campaigns: their ids.
        method: their method; empty without a campaign.
        episodes: number of completed episodes.
        failures: number of failures among them.
        probability: their confidence distributions of P(failure); None if they state nothing.
        problem: why they state nothing; empty otherwise.
        seeds: of the noise of their episodes.
        severities: severities of a random sample of the failures [m²/s²]; None if there is none.
        sampled_failures: size of that sample; failures without a severity count.
        are_counted: whether that sample is all failures that `probability` counts.
    """

    campaigns: tuple[int, ...] = ()
    method: str = ""
    episodes: int = 0
    failures: int = 0
    probability: confidence.Confidence | None = None
    problem: str = ""
    seeds: tuple[int, ...] = ()
    severities: tuple[float, ...] | None = None
    sampled_failures: int = 0
    are_counted: bool = False


class ScenarioRisk(msgspec.Struct, frozen=True, kw_only=True):
    """A scenario's part of the risk.

    Attributes:
        scenario: its name.
        encounters_per_hour: how often it is met; without an interval if the frequency is taken to
            be exact. [1/h]
        campaigns: ids of the campaigns behind the probability.
        method: their method; empty without a campaign.
        episodes: number of their completed episodes.
        failures: number of failures among them.
        probability: P(failure) in one encounter.
        per_hour: failures in an hour of driving. [1/h]
        share: share of the estimated total; None while the total is not known, or 0.
        problem: why the probability is missing; empty otherwise.
    """

    scenario: str
    encounters_per_hour: RiskFigure
    campaigns: tuple[int, ...]
    method: str
    episodes: int
    failures: int
    probability: RiskFigure
    per_hour: RiskFigure
    share: float | None
    problem: str


class SeverityRate(msgspec.Struct, frozen=True, kw_only=True):
    """Failures of a class of severity.

    Attributes:
        name: the class in words.
        per_hour: estimate of such failures in an hour of driving. [1/h]
        share: share of the estimated total; None if the total is 0.
        counted: number of such failures in the samples.
        at_most: one-sided upper bound of 95 % of such failures in an hour of driving; None if
            the failures of a scenario are not all counted by class. [1/h]
    """

    name: str
    per_hour: float
    share: float | None
    counted: int
    at_most: float | None = None


class RiskAssessment(msgspec.Struct, frozen=True, kw_only=True):
    """The risk of a planner in the scenarios of a question.

    Attributes:
        question: the question.
        planner: the planner that all campaigns tested; empty without a campaign.
        verdict: what the one-sided bounds show about the target.
        per_hour: failures in an hour of driving. While a scenario lacks an estimate, value and
            upper bounds are None, and `at_least` is the lower bound over all scenarios with an
            estimate.
        per_million_km: failures in 10^6 km; None if the distance that was driven is not known.
        scenarios: in the order of the question.
        severity: classes of severity, then failures of unknown severity; empty if no threshold is
            given, or the total is not known.
        next: the best use of the next episodes.
        notes: what limits the answer, in sentences.
    """

    question: RiskQuestion
    planner: str
    verdict: RiskVerdict
    per_hour: RiskFigure
    per_million_km: RiskFigure | None
    scenarios: tuple[ScenarioRisk, ...]
    severity: tuple[SeverityRate, ...]
    next: Allocation
    notes: tuple[str, ...] = ()


def assess(
    question: RiskQuestion,
    evidence: Sequence[ScenarioEvidence],
    planner: str = "",
    notes: Sequence[str] = (),
) -> RiskAssessment:
    """Return the risk that evidence shows.

    Args:
        question: the question.
        evidence: of each of its scenarios, in order.
        planner: the planner that the campaigns tested.
        notes: what limits the evidence, in sentences.
    """
    exposures = [find_exposure(question, each) for each in question.scenarios]
    named = list(zip(question.scenarios, exposures, evidence, strict=True))
    stated = [each for each in named if each[2].probability is not None]
    noises = name_noises([found.seeds for _, _, found in stated])
    terms = [
        confidence.RiskTerm(scenario.name, exposure, found.probability, noise, found.episodes)
        for (scenario, exposure, found), noise in zip(stated, noises, strict=True)
        if found.probability is not None
    ]
    total = _sum_terms(terms, is_complete=len(terms) == len(named))
    by_name = {term.name: term for term in terms}
    speed = question.km_per_hour
    return RiskAssessment(
        question=question,
        planner=planner,
        verdict=judge(question, total),
        per_hour=total,
        per_million_km=None if speed is None else total.scale(KM_PER_FIGURE / speed),
        scenarios=tuple(
            _describe_scenario(scenario, exposure, found, by_name.get(scenario.name), total.value)
            for scenario, exposure, found in named
        ),
        severity=_classify(question, named, total.value, by_name),
        next=allocate_episodes(
            [each.name for each in question.scenarios], terms, question.episodes
        ),
        notes=tuple(notes),
    )


def name_noises(seeds: Sequence[Sequence[int]]) -> list[str]:
    """Return a name of the noise of each scenario; equal names mean that noise may be correlated.

    Scenarios with a common seed have the same name, also if only further scenarios connect them:
    names are the connected components of scenarios and seeds.

    Args:
        seeds: seeds of each scenario's campaigns, one or more.
    """
    groups: list[frozenset[int]] = []
    for own in seeds:
        joined = frozenset(own).union(*(each for each in groups if not each.isdisjoint(own)))
        groups = [*(each for each in groups if each.isdisjoint(own)), joined]
    smallest = {seed: min(each) for each in groups for seed in each}
    return [f"seed {smallest[own[0]]}" for own in seeds]


def find_exposure(question: RiskQuestion, scenario: RiskScenario) -> confidence.Confidence:
    """Return the confidence distributions of the encounters with a scenario in an hour."""
    if scenario.encounters is not None:
        return confidence.EventRate(scenario.encounters, scenario.hours or question.exposure.hours)
    factor = 1.0 if scenario.per_hour is not None else question.km_per_hour or 0.0
    rate = scenario.per_hour if scenario.per_hour is not None else scenario.per_kilometre
    value = factor * (rate or 0.0)
    low, high = (factor * end for end in scenario.interval) if scenario.interval else (value, value)
    return confidence.Stated(value, low, high)


def judge(question: RiskQuestion, total: RiskFigure) -> RiskVerdict:
    """Return what the one-sided bounds of a total show.

    If a scenario lacks an estimate, it may fail at any rate, so the target cannot be met. If the
    scenarios with estimates alone exceed the target, the target is not met, since rates are not
    negative.
    """
    target = question.target.per_hour
    if target is None:
        target = (question.target.per_million_km or 0.0) * (question.km_per_hour or 0.0)
        target /= KM_PER_FIGURE
    if total.at_least is not None and total.at_least > target:
        return RiskVerdict.NOT_MET
    is_met = total.at_most is not None and total.at_most <= target
    return RiskVerdict.MET if is_met else RiskVerdict.UNDECIDED


def _sum_terms(terms: Sequence[confidence.RiskTerm], *, is_complete: bool) -> RiskFigure:
    bounds = confidence.bound_sum(terms)
    if not is_complete:
        return RiskFigure(value=None, at_least=bounds.at_least)
    values = [term.value for term in terms]
    known = [value for value in values if value is not None]
    return _make_figure(sum(known) if len(known) == len(values) else None, bounds)


def _make_figure(value: float | None, bounds: confidence.RateBounds) -> RiskFigure:
    return RiskFigure(
        value=value, interval=bounds.interval, at_least=bounds.at_least, at_most=bounds.at_most
    )


def _describe_scenario(
    scenario: RiskScenario,
    exposure: confidence.Confidence,
    found: ScenarioEvidence,
    term: confidence.RiskTerm | None,
    total: float | None,
) -> ScenarioRisk:
    part = NOTHING_KNOWN if term is None else _make_figure(term.value, confidence.bound_sum([term]))
    probability = found.probability
    return ScenarioRisk(
        scenario=scenario.name,
        encounters_per_hour=_describe_factor(exposure),
        campaigns=found.campaigns,
        method=found.method,
        episodes=found.episodes,
        failures=found.failures,
        probability=NOTHING_KNOWN if probability is None else _describe_factor(probability),
        per_hour=part,
        share=part.value / total if total and part.value is not None else None,
        problem=found.problem,
    )


def _describe_factor(known: confidence.Confidence) -> RiskFigure:
    """Return a factor with its interval; the interval is None if the factor is exact."""
    interval = confidence.bound_factor(known)
    is_exact = interval.low == interval.high
    return RiskFigure(value=known.value, interval=None if is_exact else interval)


UNCLASSIFIED = "not known"
"""Class of the failures of which no sample says how severe they are."""

NO_SEVERITY = "no collision"
"""Class of the failures without a severity: violations of a requirement other than no collision."""


def name_classes(thresholds: Sequence[float]) -> list[str]:
    """Return the names of the classes between thresholds, in rising order."""
    ends = [f"{each:g}" for each in thresholds]
    inner = [f"{low} to {high}" for low, high in pairwise(ends)]
    return [f"below {ends[0]}", *inner, f"{ends[-1]} or more"]


def _classify(
    question: RiskQuestion,
    named: Sequence[tuple[RiskScenario, confidence.Confidence, ScenarioEvidence]],
    total: float | None,
    terms: Mapping[str, confidence.RiskTerm],
) -> tuple[SeverityRate, ...]:
    """Return the classes of severity, by each scenario's share of failures in each of them."""
    if not question.severity or total is None:
        return ()
    names = [*name_classes(question.severity), NO_SEVERITY, UNCLASSIFIED]
    rates, counted = dict.fromkeys(names, 0.0), dict.fromkeys(names, 0)
    counts = [_count_classes(question.severity, found) for _, _, found in named]
    for (_, exposure, found), of_one in zip(named, counts, strict=True):
        value = found.probability.value if found.probability else None
        rate = (exposure.value or 0.0) * (value or 0.0)
        seen = sum(of_one.values())
        if not seen:
            rates[UNCLASSIFIED] += rate
        for name, count in of_one.items():
            counted[name] += count
            rates[name] += rate * count / seen if seen else 0.0
    shown = [
        name
        for name in names
        if name not in (NO_SEVERITY, UNCLASSIFIED) or rates[name] or counted[name]
    ]
    of_all = [
        (terms[scenario.name], of_one, found.are_counted)
        for (scenario, _, found), of_one in zip(named, counts, strict=True)
    ]
    return tuple(
        SeverityRate(
            name=name,
            per_hour=rates[name],
            share=rates[name] / total if total else None,
            counted=counted[name],
            at_most=_bound_class(name, of_all),
        )
        for name in shown
    )


def _bound_class(
    name: str, of_all: Sequence[tuple[confidence.RiskTerm, Mapping[str, int], bool]]
) -> float | None:
    """Return the one-sided upper bound of the failures of a class in an hour, by melding. [1/h]

    Episodes of a fixed number that fail in this class are a binomial number as all failures are, so
    that the bounds of Clopper and Pearson hold for them. None if a scenario has other evidence.

    Args:
        name: the class.
        of_all: term of each scenario, its counts by class, and whether these are of all failures
            that the term counts.
    """
    bounded = []
    for term, counts, are_counted in of_all:
        known = term.probability
        if not are_counted or name not in counts or not isinstance(known, confidence.FailureShare):
            return None
        bounded.append(replace(term, probability=known.restrict_to(counts[name])))
    return confidence.bound_sum_above(bounded)


def _count_classes(thresholds: Sequence[float], found: ScenarioEvidence) -> dict[str, int]:
    """Return the number of sampled failures in each class; no class without a sample."""
    if found.severities is None:
        return {}
    names = name_classes(thresholds)
    counts = dict.fromkeys((*names, NO_SEVERITY), 0)
    for severity in found.severities:
        counts[names[sum(severity >= each for each in thresholds)]] += 1
    counts[NO_SEVERITY] = found.sampled_failures - len(found.severities)
    return counts
