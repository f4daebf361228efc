"""Verdicts of outputs on the criteria of their solutions: supported, refuted or undecided.

All numbers follow from the episodes, estimates and numbers of unresolved episodes of campaigns. The
verification of a bundle computes them again.
"""

from collections.abc import Callable, Mapping, Sequence
from enum import StrEnum
from math import isclose
from typing import Any

import msgspec
from msgspec.structs import replace

from eigenfail.errors import InvalidValue
from eigenfail.gate.report import build_report
from eigenfail.presentation.figures import (
    count_noun,
    format_count,
    format_number,
    round_down,
    round_up,
)
from eigenfail.values.campaign import CampaignState
from eigenfail.values.episode import Outcome
from eigenfail.values.estimates import Interval
from eigenfail.values.proof import ReplayedNoise, ReplayKind
from eigenfail_assurance.evidence import counting
from eigenfail_assurance.evidence.gates import find_gate_problems
from eigenfail_assurance.evidence.question import (
    AnySolution,
    GateSolution,
    ProbabilitySolution,
    ReplaySolution,
    RiskSolution,
    SearchSolution,
    SensorSolution,
)
from eigenfail_assurance.evidence.records import SolutionInput
from eigenfail_assurance.risk import assessment
from eigenfail_assurance.risk.confidence import Confidence, FailureShare, RunEstimate
from eigenfail_assurance.risk.sentences import describe_verdict, format_target
from eigenfail_assurance.sensor.anchors import bound_sampled, judge_bounds
from eigenfail_assurance.sensor.search import Anchor, AnchorVerdict
from eigenfail_assurance.sensor.sentences import format_confidence

TOLERANCE = 1e-9
"""Relative difference of numbers that are taken for equal: processors differ in the last bits."""


class ClaimVerdict(StrEnum):
    """Verdict on a claim or a solution.

    `undeveloped` is a claim without sub-claims and solutions.
    """

    SUPPORTED = "supported"
    REFUTED = "refuted"
    UNDECIDED = "undecided"
    UNDEVELOPED = "undeveloped"


Figures = Mapping[str, int | float | None]
"""Numbers by name; None where there is none."""


class SolutionFinding(msgspec.Struct, frozen=True, kw_only=True):
    """The findings of an output.

    Attributes:
        verdict: supported, refuted or undecided.
        words: why, in a sentence.
        figures: the numbers behind it, by name; None if there is none.
    """

    verdict: ClaimVerdict
    words: str
    figures: Figures = {}


def judge_solution(
    solution: AnySolution, given: SolutionInput, campaigns: counting.Counted
) -> SolutionFinding:
    """Return what the output of a solution shows about its criterion.

    Args:
        solution: output and criterion.
        given: data from the service besides the campaigns.
        campaigns: all campaigns of the question, by id.

    Raises:
        InvalidValue: episodes cannot be read.
    """
    if given.missing:
        return _leave_undecided(" ".join(given.missing))
    judge: Callable[[Any, SolutionInput, counting.Counted], SolutionFinding] = _JUDGES[
        type(solution)
    ]
    return judge(solution, given, campaigns)


def _leave_undecided(words: str, **figures: float | None) -> SolutionFinding:
    return SolutionFinding(verdict=ClaimVerdict.UNDECIDED, words=words, figures=dict(figures))


def _list_group(
    given: SolutionInput, campaigns: counting.Counted
) -> list[counting.CountedCampaign]:
    return [campaigns[each] for group in given.campaigns for each in group]


def _judge_probability(
    solution: ProbabilitySolution, given: SolutionInput, campaigns: counting.Counted
) -> SolutionFinding:
    group = _list_group(given, campaigns)
    if problem := counting.explain_no_probability(group):
        return _leave_undecided(f"No probability is known: {problem}")
    bounds = counting.bound_probability(group, 1.0 - solution.confidence)
    figures = {
        "episodes": counting.sum_completed(group),
        "failures": counting.sum_failures(group),
        "errored": counting.sum_errored(group),
        "probability": counting.estimate_probability(group),
        "at_least": bounds.low,
        "at_most": bounds.high,
    }
    if unresolved := counting.sum_unresolved(group):
        figures["unresolved"] = unresolved
    verdict = _VERDICTS_OF_BOUNDS[judge_bounds(bounds, solution.at_most)]
    words = f"{_describe_bound(verdict, bounds, solution)}: {_describe_basis(group)}."
    return SolutionFinding(verdict=verdict, words=words, figures=figures)


_VERDICTS_OF_BOUNDS = {
    AnchorVerdict.MET: ClaimVerdict.SUPPORTED,
    AnchorVerdict.NOT_MET: ClaimVerdict.REFUTED,
    AnchorVerdict.UNDECIDED: ClaimVerdict.UNDECIDED,
}


def _describe_bound(verdict: ClaimVerdict, bounds: Interval, solution: ProbabilitySolution) -> str:
    """Return the bounds, rounded outwards, that show the verdict."""
    low, high = format_number(round_down(bounds.low)), format_number(round_up(bounds.high))
    wanted, sure = format_target(solution.at_most), format_confidence(solution.confidence)
    words = {
        ClaimVerdict.SUPPORTED: f"at most {high}, within the accepted {wanted}",
        ClaimVerdict.REFUTED: f"at least {low}, above the accepted {wanted}",
        ClaimVerdict.UNDECIDED: f"{low} to {high}, around the accepted {wanted}",
    }
    return f"P(failure) is {words[verdict]} ({sure} confidence)"


def _describe_basis(group: Sequence[counting.CountedCampaign]) -> str:
    names = ", ".join(str(each.campaign.id) for each in group)
    method = group[0].campaign.spec.method
    failures, completed = counting.sum_failures(group), counting.sum_completed(group)
    where = f"campaign{'s' * (len(group) > 1)} {names} ({method})"
    if method != counting.MONTE_CARLO:
        return f"the estimate of {where} from {count_noun(completed, 'episode')}"
    return f"{format_count(failures)} of {count_noun(completed, 'episode')} of {where} failed"


def assess_recorded_risk(
    solution: RiskSolution, given: SolutionInput, campaigns: counting.Counted
) -> assessment.RiskAssessment:
    """Return the risk that recorded campaigns show, without classes of severity."""
    groups = [[campaigns[each] for each in group] for group in given.campaigns]
    known = [_collect_evidence(group) for group in groups]
    planner = next((each.campaign.spec.planner for group in groups for each in group), "")
    return assessment.assess(replace(solution.question, severity=()), known, planner, given.notes)


def _collect_evidence(group: Sequence[counting.CountedCampaign]) -> assessment.ScenarioEvidence:
    problem = counting.explain_no_probability(group)
    if not problem and counting.is_ended_by_failures(group):
        problem = f"a stop rule on failures ended campaign {group[0].campaign.id}."
    return assessment.ScenarioEvidence(
        campaigns=tuple(each.campaign.id for each in group),
        method=group[0].campaign.spec.method if group else "",
        episodes=counting.sum_completed(group),
        failures=counting.sum_failures(group),
        probability=None if problem else _find_confidence(group),
        problem=problem,
        seeds=tuple(each.campaign.spec.seed for each in group),
    )


def _find_confidence(group: Sequence[counting.CountedCampaign]) -> Confidence | None:
    first = group[0].campaign
    if first.spec.method != counting.MONTE_CARLO:
        return RunEstimate.of(first.estimate) if first.estimate else None
    errored = counting.sum_errored(group)
    trials = counting.sum_completed(group) + errored
    value, unresolved = counting.estimate_probability(group), counting.sum_unresolved(group)
    return FailureShare(counting.sum_failures(group), errored, trials, value, unresolved)


_VERDICTS_OF_RISK = {
    assessment.RiskVerdict.MET: ClaimVerdict.SUPPORTED,
    assessment.RiskVerdict.NOT_MET: ClaimVerdict.REFUTED,
    assessment.RiskVerdict.UNDECIDED: ClaimVerdict.UNDECIDED,
}


def _judge_risk(
    solution: RiskSolution, given: SolutionInput, campaigns: counting.Counted
) -> SolutionFinding:
    found = assess_recorded_risk(solution, given, campaigns)
    total, distance = found.per_hour, found.per_million_km
    figures = {
        "per_hour": total.value,
        "at_least_per_hour": total.at_least,
        "at_most_per_hour": total.at_most,
        "at_least_per_million_km": distance.at_least if distance else None,
        "at_most_per_million_km": distance.at_most if distance else None,
    }
    verdict = _VERDICTS_OF_RISK[found.verdict]
    return SolutionFinding(verdict=verdict, words=describe_verdict(found), figures=figures)


def _judge_search(
    solution: SearchSolution, given: SolutionInput, campaigns: counting.Counted
) -> SolutionFinding:
    group = _list_group(given, campaigns)
    failures, errored, completed = (
        counting.sum_failures(group),
        counting.sum_errored(group),
        counting.sum_completed(group),
    )
    figures = {"episodes": completed, "failures": failures, "errored": errored}
    names = ", ".join(f"{each.campaign.id} ({each.campaign.spec.method})" for each in group)
    seen = (
        f"{format_count(failures)} of {count_noun(completed, 'episode')} of campaign"
        f"{'s' * (len(group) > 1)} {names} failed; "
        f"{format_count(solution.failures_at_most)} or fewer are accepted."
    )
    if failures > solution.failures_at_most:
        return SolutionFinding(verdict=ClaimVerdict.REFUTED, words=seen, figures=figures)
    if problem := _explain_unfinished(solution, group, completed, errored):
        return _leave_undecided(f"{seen} Undecided: {problem}", **figures)
    return SolutionFinding(verdict=ClaimVerdict.SUPPORTED, words=seen, figures=figures)


def _explain_unfinished(
    solution: SearchSolution,
    group: Sequence[counting.CountedCampaign],
    completed: int,
    errored: int,
) -> str:
    for each in group:
        if each.campaign.state is not CampaignState.DONE:
            return f"campaign {each.campaign.id} is {each.campaign.state_word}."
    if problem := counting.explain_gaps(group):
        return problem
    if errored:
        return f"{count_noun(errored, 'episode')} errored, and may have failed."
    if completed < solution.episodes_at_least:
        return f"{format_count(solution.episodes_at_least)} completed episodes are wanted."
    return ""


def _judge_replay(
    solution: ReplaySolution, given: SolutionInput, campaigns: counting.Counted
) -> SolutionFinding:
    proof = given.proof
    if proof is None or not proof.done:
        return _leave_undecided("The modes have no proof by replay, or it has not ended.")
    replays = [
        each
        for scenario in proof.scenarios
        if scenario.is_same
        for each in scenario.replays
        if each.what is ReplayKind.EIGENFAILURE
    ]
    outcomes = [_find_outcome(each, campaigns) for each in replays]
    known = [each for each in outcomes if each is not None]
    tried = [each for each in known if each is not Outcome.ERRORED]
    again = sum(each.is_failure for each in tried)
    figures = {"eigenfailures": len(replays), "tried": len(tried), "reproduced": again}
    if len(tried) < len(replays) or not tried:
        words = f"{len(tried)} of {count_noun(len(replays), 'eigenfailure')} could be replayed."
        return _leave_undecided(words, **figures)
    enough = again >= solution.reproduced_at_least * len(tried)
    words = (
        f"{again} of {count_noun(len(tried), 'eigenfailure')} of analysis {proof.analysis} failed "
        "again in the scenario of their failures."
    )
    verdict = ClaimVerdict.SUPPORTED if enough else ClaimVerdict.REFUTED
    return SolutionFinding(verdict=verdict, words=words, figures=figures)


def _find_outcome(replay: ReplayedNoise, campaigns: counting.Counted) -> Outcome | None:
    return campaigns[replay.campaign].outcomes.get(replay.index)


def _judge_gate(
    solution: GateSolution, _given: SolutionInput, campaigns: counting.Counted
) -> SolutionFinding:
    report = solution.report
    figures = {f"{verdict}": count for verdict, count in sorted(report.counts.items())}
    if problem := _explain_no_gate(solution, campaigns):
        return _leave_undecided(
            f"The gate of {report.gate.run} shows nothing: {problem}", **figures
        )
    came = ", ".join(f"{count} {verdict}" for verdict, count in sorted(report.counts.items()))
    state = "open" if report.open else "closed"
    against = report.gate.baseline
    return SolutionFinding(
        verdict=ClaimVerdict.SUPPORTED if report.open else ClaimVerdict.REFUTED,
        words=f"The gate of {report.gate.run} against {against} is {state}: {came}.",
        figures=figures,
    )


def _explain_no_gate(solution: GateSolution, campaigns: counting.Counted) -> str:
    report = solution.report
    again = build_report(report.gate, report.members)
    if (again.open, again.counts) != (report.open, report.counts):
        return "its counts are not those of its members."
    if not report.gate.baseline or not report.counts:
        return "there is no baseline to compare with, or nothing of it was run."
    if report.in_trouble:
        return "episodes were lost."
    return next(find_gate_problems(report, campaigns), "")


def _judge_sensor(
    solution: SensorSolution, _given: SolutionInput, campaigns: counting.Counted
) -> SolutionFinding:
    question, channel = solution.answer.question, solution.channel
    anchors = [each for each in solution.answer.anchors if each.multiples.keys() == {channel}]
    if not anchors:
        return _leave_undecided(f"The answer has no limit of '{channel}'.")
    verdicts = {}
    for anchor in anchors:
        bounds, problem = _bound_anchor(anchor, campaigns, question.test_error)
        if problem:
            return _leave_undecided(problem)
        judged = judge_bounds(bounds, question.target)
        verdicts[anchor.multiples[channel]] = AnchorVerdict.UNKNOWN if anchor.problem else judged
    met = [size for size, verdict in verdicts.items() if verdict is AnchorVerdict.MET]
    missed = [size for size, verdict in verdicts.items() if verdict is AnchorVerdict.NOT_MET]
    figures = {"largest_met": max(met, default=None), "smallest_missed": min(missed, default=None)}
    target = f"the target P(failure) ≤ {format_target(question.target)}"
    wanted = f"{channel} × {solution.multiple:g}"
    if any(size <= solution.multiple for size in missed):
        words = f"{target} is missed at {channel} × {min(missed):g}, and so at {wanted}."
        verdict = ClaimVerdict.REFUTED
    elif any(size >= solution.multiple for size in met):
        words = f"{target} is met up to {channel} × {max(met):g}, and so at {wanted}."
        verdict = ClaimVerdict.SUPPORTED
    else:
        words, verdict = f"{target} is neither met nor missed at {wanted}.", ClaimVerdict.UNDECIDED
    return SolutionFinding(verdict=verdict, words=words[:1].upper() + words[1:], figures=figures)


def _bound_anchor(
    anchor: Anchor, campaigns: counting.Counted, error: float
) -> tuple[Interval, str]:
    """Return the bounds of an anchor from its campaign, and why they differ from the answer's.

    Raises:
        InvalidValue: episodes cannot be read.
    """
    counted = campaigns[anchor.campaign]
    if anchor.problem:
        return anchor.bounds, ""
    if counted.campaign.state is not CampaignState.DONE:
        return anchor.bounds, f"Campaign {anchor.campaign} is {counted.campaign.state_word}."
    if problem := counting.explain_gaps([counted]):
        return anchor.bounds, f"{problem[:1].upper()}{problem[1:]}"
    try:
        found = (
            bound_sampled(counted.counted, error, counted.unresolved)
            if counted.campaign.spec.method == counting.MONTE_CARLO
            else counting.bound_probability([counted], error)
        )
    except InvalidValue:
        return anchor.bounds, f"Campaign {anchor.campaign} has no estimate with an interval."
    pairs = ((found.low, anchor.bounds.low), (found.high, anchor.bounds.high))
    if all(isclose(one, other, rel_tol=TOLERANCE) for one, other in pairs):
        return found, ""
    return found, f"The answer has other bounds than campaign {anchor.campaign}."


_JUDGES: Mapping[type, Callable[..., SolutionFinding]] = {
    ProbabilitySolution: _judge_probability,
    RiskSolution: _judge_risk,
    SearchSolution: _judge_search,
    ReplaySolution: _judge_replay,
    GateSolution: _judge_gate,
    SensorSolution: _judge_sensor,
}
