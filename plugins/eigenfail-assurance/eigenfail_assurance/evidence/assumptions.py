"""Contexts and assumptions of a solution, gathered from the campaigns and estimates behind it."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import msgspec

from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail.versions import describe_mixed
from eigenfail.worlds import describe_disturbance, world_of
from eigenfail_assurance.evidence import question
from eigenfail_assurance.evidence.counting import MONTE_CARLO, Counted, CountedCampaign
from eigenfail_assurance.evidence.judgement import assess_recorded_risk
from eigenfail_assurance.evidence.records import SolutionInput, list_campaigns
from eigenfail_assurance.risk.sentences import list_limits


class Surroundings(NamedTuple):
    """Contexts and assumptions of a solution.

    Attributes:
        context: planner, scenario, p(x) and requirements of its campaigns, in sentences.
        assumptions: what must be true for it, in sentences.
    """

    context: tuple[str, ...]
    assumptions: tuple[str, ...]


def gather_surroundings(
    solution: question.AnySolution, given: SolutionInput, campaigns: Counted
) -> Surroundings:
    """Return the contexts and assumptions of a solution, each sentence once.

    Args:
        solution: output and criterion.
        given: data from the service besides the campaigns.
        campaigns: all campaigns of the question, by id.
    """
    used = [campaigns[each] for each in list_campaigns(solution, given)]
    context = [line for each in used for line in _list_context(each)]
    assumptions = [
        *(line for each in used for line in _list_world_assumptions(each.campaign.spec)),
        *_LISTERS[type(solution)](solution, given, campaigns),
        *(line for each in used for line in describe_mixed(each.campaign)),
    ]
    return Surroundings(tuple(dict.fromkeys(context)), tuple(dict.fromkeys(assumptions)))


def _list_context(counted: CountedCampaign) -> Iterator[str]:
    """Yield planner, scenario, p(x) and requirements of a campaign."""
    spec, planner = counted.campaign.spec, counted.record.facts.planner
    version = f", version {planner.version}" if planner.version else ""
    yield f"Planner '{planner.name}'{version}, settings: {_format_settings(planner.settings)}."
    yield (
        f"Scenario '{spec.scenario}' of simulator '{spec.simulator}': "
        f"{_format_settings(spec.scenario_parameters)}."
    )
    model = "; ".join(f"{name}: {words}" for name, words in describe_disturbance(spec).items())
    yield f"Disturbance model p(x): {model}."
    required = "; ".join(each.in_words() for each in spec.all_requirements)
    yield f"An episode fails if it violates: {required}."


def _format_settings(settings: Mapping[str, Any]) -> str:
    plain = msgspec.to_builtins(settings, order="sorted")
    return (
        ", ".join(f"{name} = {_format_value(value)}" for name, value in plain.items()) or "defaults"
    )


def _format_value(value: Any) -> str:
    return msgspec.json.encode(value, order="sorted").decode().replace('"', "'")


def _list_world_assumptions(spec: CampaignSpec) -> Iterator[str]:
    """Yield the assumptions of the simulation about the road."""
    yield "The errors of the sensor on the road are distributed as p(x) says."
    if world_of(spec.simulator).has_road:
        yield (
            f"Vehicles and road are as the simulator '{spec.simulator}' models them; what scenario "
            f"'{spec.scenario}' leaves out is not part of the result."
        )


def _list_probability_assumptions(counted: CountedCampaign) -> Iterator[str]:
    """Yield the assumptions of a campaign's estimate."""
    campaign = counted.campaign
    method, estimate = campaign.spec.method, campaign.estimate
    if method == MONTE_CARLO:
        yield "Episodes of 'monte_carlo' are independent draws of the noise from p(x)."
        if campaign.counts.errored:
            yield "Errored episodes count as failures in upper bounds, and as none in lower ones."
        if counted.unresolved:
            yield (
                "Episodes that ended unresolved count as failures in upper bounds, "
                "and as none in lower ones."
            )
        return
    yield (
        f"The interval of '{method}' is approximate: the logarithm of the estimate is taken to be "
        "normally distributed."
    )
    if estimate is not None and estimate.note:
        yield f"{method}: {estimate.note}"


def _list_used(given: SolutionInput, campaigns: Counted) -> Sequence[CountedCampaign]:
    return [campaigns[each] for group in given.campaigns for each in group]


def _list_for_probability(
    _solution: question.ProbabilitySolution, given: SolutionInput, campaigns: Counted
) -> Iterator[str]:
    for each in _list_used(given, campaigns):
        yield from _list_probability_assumptions(each)
    yield from given.notes


def _list_for_risk(
    solution: question.RiskSolution, given: SolutionInput, campaigns: Counted
) -> Iterator[str]:
    for each in _list_used(given, campaigns):
        yield from _list_probability_assumptions(each)
    yield (
        "Encounters are a Poisson number, scenarios do not overlap, and the road of the target is "
        "met as the log was driven."
    )
    limits = list_limits(assess_recorded_risk(solution, given, campaigns))
    yield from (each for each in limits if not each.startswith("No estimate for"))


def _list_for_search(
    _solution: question.SearchSolution, _given: SolutionInput, _campaigns: Counted
) -> Iterator[str]:
    yield (
        "A count of the failures of a search states no probability: failures that it did not come "
        "near are not in it."
    )


def _list_for_replay(
    _solution: question.ReplaySolution, _given: SolutionInput, _campaigns: Counted
) -> Iterator[str]:
    yield "Replays repeat chosen noise: the share that fails again is no probability."


def _list_for_gate(
    _solution: question.GateSolution, _given: SolutionInput, _campaigns: Counted
) -> Iterator[str]:
    yield "The gate compares versions under the noise of its baseline; other noise is not tried."


def _list_for_sensor(
    _solution: question.SensorSolution, _given: SolutionInput, _campaigns: Counted
) -> Iterator[str]:
    yield "P(failure) does not fall as errors of the sensor grow."


_LISTERS: Mapping[type, Callable[..., Iterator[str]]] = {
    question.ProbabilitySolution: _list_for_probability,
    question.RiskSolution: _list_for_risk,
    question.SearchSolution: _list_for_search,
    question.ReplaySolution: _list_for_replay,
    question.GateSolution: _list_for_gate,
    question.SensorSolution: _list_for_sensor,
}
