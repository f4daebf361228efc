"""Comparison of the campaigns behind a solution with the campaigns that its question names."""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from itertools import combinations
from typing import Any

from eigenfail.errors import InvalidValue
from eigenfail.values.campaign import Campaign
from eigenfail_assurance.evidence import question
from eigenfail_assurance.evidence.counting import REPLAYING, Counted
from eigenfail_assurance.evidence.records import SolutionInput
from eigenfail_assurance.risk.pooling import are_alike, find_planner, refuse_unlike
from eigenfail_assurance.risk.question import CampaignReference

_References = Sequence[Sequence[CampaignReference]]
_Groups = Sequence[Sequence[Campaign]]


def check_references(
    name: str, solution: question.AnySolution, given: SolutionInput, campaigns: Counted
) -> None:
    """Refuse campaigns that a solution does not name, or that cannot be counted together.

    Only the service can check that a campaign is the newest of its name.

    Args:
        name: number of the solution in the graph.
        solution: output and criterion.
        given: the campaigns that the service took for it.
        campaigns: all campaigns of the question, by id.

    Raises:
        InvalidValue: other campaigns are named, one of them twice, or they do not go together.
    """
    field = f"{name}: campaigns"
    named = _REFERENCES[type(solution)](solution)
    if [*map(len, named)] != [*map(len, given.campaigns)]:
        said, found = ([len(group) for group in each] for each in (named, given.campaigns))
        raise InvalidValue(field, f"the question names {said} campaigns, and {found} are given.")
    groups = [[campaigns[each].campaign for each in group] for group in given.campaigns]
    for references, group in zip(named, groups, strict=True):
        for reference, campaign in zip(references, group, strict=True):
            if reference not in {campaign.id, campaign.spec.name}:
                problem = f"the question names {reference!r}, and campaign {campaign.id} is given."
                raise InvalidValue(field, problem)
    times = Counter(each for group in given.campaigns for each in group)
    if twice := [str(campaign) for campaign, count in times.items() if count > 1]:
        problem = f"campaign {', '.join(twice)} is named twice."
        raise InvalidValue(field, problem, "Name each campaign once.")
    check: Callable[[str, SolutionInput, _Groups, Counted], None] = _CHECKS[type(solution)]
    check(name, given, groups, campaigns)


def _list_campaigns(
    solution: question.ProbabilitySolution | question.SearchSolution,
) -> _References:
    return (solution.campaigns,)


def _list_scenarios(solution: question.RiskSolution) -> _References:
    return tuple(each.campaigns for each in solution.question.scenarios)


def _list_campaign(solution: question.ReplaySolution) -> _References:
    return ((solution.campaign,),)


def _list_none(_solution: question.GateSolution | question.SensorSolution) -> _References:
    return ()


_REFERENCES: Mapping[type, Callable[[Any], _References]] = {
    question.ProbabilitySolution: _list_campaigns,
    question.RiskSolution: _list_scenarios,
    question.SearchSolution: _list_campaigns,
    question.ReplaySolution: _list_campaign,
    question.GateSolution: _list_none,
    question.SensorSolution: _list_none,
}


def _check_pools(name: str, _given: SolutionInput, groups: _Groups, _campaigns: Counted) -> None:
    """Refuse groups that cannot be counted together, and several planners."""
    for group in groups:
        refuse_unlike(group, f"{name}: campaigns")
    find_planner(groups, f"{name}: ")


def _check_search(name: str, _given: SolutionInput, groups: _Groups, _campaigns: Counted) -> None:
    """Refuse a search whose episodes are counted twice; otherwise searches may differ."""
    for one, other in combinations([each for group in groups for each in group], 2):
        is_same = one.spec.seed == other.spec.seed or one.spec.method in REPLAYING
        if is_same and are_alike(one.spec, other.spec):
            problem = f"campaigns {one.id} and {other.id} have the same seeds, and so the same"
            remedy = "Name campaigns with different seeds; of replays of the same noise, name one."
            raise InvalidValue(f"{name}: campaigns", f"{problem} episodes.", remedy)


def _check_replays(name: str, given: SolutionInput, groups: _Groups, campaigns: Counted) -> None:
    """Refuse replays of another analysis than the proof's, or with another planner."""
    if given.proof is None:
        return
    planner = find_planner(groups)
    same = (each for each in given.proof.scenarios if each.is_same)
    for number in sorted({replay.campaign for each in same for replay in each.replays}):
        replay = campaigns[number].campaign
        if replay.spec.settings.get("analysis") != given.proof.analysis:
            problem = f"campaign {number} does not replay analysis {given.proof.analysis}."
            raise InvalidValue(f"{name}: proof", problem)
        settings = groups[0][0].spec.planner_settings
        if (replay.spec.planner, replay.spec.planner_settings) != (planner, settings):
            problem = f"campaign {number} tests another planner than campaign {groups[0][0].id}."
            raise InvalidValue(f"{name}: proof", problem)


def _check_nothing(_name: str, _given: SolutionInput, _groups: _Groups, _all: Counted) -> None:
    """Accept a solution whose campaigns come from a file in the question."""


_CHECKS: Mapping[type, Callable[[str, SolutionInput, _Groups, Counted], None]] = {
    question.ProbabilitySolution: _check_pools,
    question.RiskSolution: _check_pools,
    question.SearchSolution: _check_search,
    question.ReplaySolution: _check_replays,
    question.GateSolution: _check_nothing,
    question.SensorSolution: _check_nothing,
}
