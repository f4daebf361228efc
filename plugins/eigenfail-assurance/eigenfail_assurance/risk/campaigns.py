"""The evidence of campaigns on a risk: which of their figures state a probability of failure."""

from collections.abc import Iterator, Sequence
from itertools import chain
from typing import NamedTuple

from eigenfail.errors import Conflict, InvalidValue, ProtocolError
from eigenfail.methods import traits_of
from eigenfail.presentation.figures import count_noun
from eigenfail.values.campaign import FINAL_STATES, Campaign, CampaignFilter, CampaignState
from eigenfail.values.estimates import Rate, RateDesign
from eigenfail_assurance.risk.assessment import RiskAssessment, ScenarioEvidence, assess
from eigenfail_assurance.risk.confidence import Confidence, FailureShare, RunEstimate, Stated
from eigenfail_assurance.risk.pooling import find_planner, pick_named, refuse_unlike
from eigenfail_assurance.risk.question import CampaignReference, RiskQuestion, RiskScenario
from eigenfail_services.analysis.sampling_design import SamplingDesign
from eigenfail_services.campaigns.analysis_jobs import find_first_samples
from eigenfail_services.campaigns.summary import (
    count_unresolved,
    find_chain_mixing,
    find_failure_rate,
)
from eigenfail_services.store.store import Store

CHAINS = "chains"
"""The method whose failures after burn-in are samples of p(z | failure)."""

NO_CAMPAIGN = "no campaign is named: run one of monte_carlo, subset, mixture or splitting."

ONE_ESTIMATE = (
    "several campaigns are counted together only where all are of Monte Carlo with a fixed number "
    "of episodes: name one, with a larger budget."
)


class _Probability(NamedTuple):
    """Confidence distributions of P(failure) from campaigns, or why there are none."""

    known: Confidence | None
    problem: str = ""


def assess_campaigns(store: Store, question: RiskQuestion) -> RiskAssessment:
    """Return the risk that the campaigns of a question show.

    Raises:
        NotFound: no campaign has the id or name.
        InvalidValue: a campaign is named twice, tests another planner than the rest, or cannot be
            counted together with the campaigns of its scenario.
    """
    used: dict[int, str] = {}
    found: list[list[Campaign]] = []
    for place, scenario in enumerate(question.scenarios):
        field = f"scenarios[{place}].campaigns"
        campaigns = [find_campaign(store, each) for each in scenario.campaigns]
        for each in campaigns:
            if other := used.get(each.id):
                problem = f"campaign {each.id} is named twice, first by '{other}'."
                raise InvalidValue(field, problem, "Name each campaign once.")
            used[each.id] = scenario.name
        refuse_unlike(campaigns, field)
        found.append(campaigns)
    planner = find_planner(found)
    sampled = [
        find_sampled(store, scenario, campaigns, f"scenarios[{place}].failures_from")
        for place, (scenario, campaigns) in enumerate(zip(question.scenarios, found, strict=True))
    ]
    evidence = [collect_evidence(store, *each) for each in zip(found, sampled, strict=True)]
    named = zip(question.scenarios, found, evidence, strict=True)
    stated = [campaigns for _, campaigns, each in named if each.probability is not None]
    notes = [
        *_list_notes(found, sampled),
        *_count_errored([each for of_one in stated for each in of_one]),
        *_count_unresolved(store, [each for of_one in stated for each in of_one]),
        *_describe_chains(store, [each for of_one in sampled for each in of_one]),
    ]
    return assess(question, evidence, planner, notes)


def find_campaign(store: Store, reference: CampaignReference) -> Campaign:
    """Return the campaign of an id, or the only one of a name.

    Raises:
        NotFound: no campaign has the id or name.
        InvalidValue: several have the name.
    """
    if isinstance(reference, int):
        return store.campaigns.get(reference)
    alike = store.campaigns.iterate(CampaignFilter(search=reference))
    return pick_named(reference, [each for each in alike if each.spec.name == reference])


def find_sampled(
    store: Store, scenario: RiskScenario, campaigns: Sequence[Campaign], field: str
) -> list[Campaign]:
    """Return the campaigns whose failures are a random sample of a scenario's failures, if any.

    Args:
        store: store of the campaigns.
        scenario: the scenario of a question.
        campaigns: its campaigns, which are alike.
        field: name of its field `failures_from`, for errors.

    Raises:
        NotFound: the campaign `failures_from` does not exist.
        InvalidValue: the failures of `failures_from` are not a sample of p(z | failure), it is on
            another scenario, or it has not ended.
    """
    if scenario.failures_from is not None:
        sampled = find_campaign(store, scenario.failures_from)
        _refuse_other_failures(sampled, campaigns, field)
        return [sampled]
    drawn = [each for each in campaigns if traits_of(each.spec.method).draws_from_prior]
    return drawn if len(drawn) == len(campaigns) else []


def collect_evidence(
    store: Store, campaigns: Sequence[Campaign], sampled: Sequence[Campaign]
) -> ScenarioEvidence:
    """Return the evidence of campaigns on a scenario.

    Args:
        store: store of their failures.
        campaigns: campaigns of the scenario, which are alike.
        sampled: campaigns whose failures are a random sample; for `chains`, only after burn-in.
    """
    known, problem = find_probability(campaigns, _sum_unresolved(store, campaigns))
    first_samples = find_first_samples(sampled)
    samples = [
        store.episodes.sample_severities(each.id, first_samples.get(each.id, 0)) for each in sampled
    ]
    return ScenarioEvidence(
        campaigns=tuple(each.id for each in campaigns),
        method=", ".join(sorted({each.spec.method for each in campaigns})),
        episodes=sum(each.counts.completed for each in campaigns),
        failures=sum(each.counts.failures for each in campaigns),
        probability=known,
        problem=problem,
        seeds=tuple(each.spec.seed for each in campaigns),
        severities=tuple(chain.from_iterable(each.severities for each in samples))
        if samples
        else None,
        sampled_failures=sum(each.failures for each in samples),
        are_counted=[each.id for each in sampled] == [each.id for each in campaigns],
    )


def find_probability(campaigns: Sequence[Campaign], unresolved: int = 0) -> _Probability:
    """Return the evidence of one scenario's campaigns on P(failure).

    Episodes give it if `SamplingDesign` calls them a sample of p(x). A method's estimate gives it
    if the method declares `bounds_probability`, and the estimate has an interval and is not a lower
    bound. The failures of a search state nothing.

    Args:
        campaigns: campaigns of the scenario, which are alike.
        unresolved: number of their episodes that ended before what may have become a failure; they
            count as failures in the upper bounds of episodes that were drawn from p(x).
    """
    if not campaigns:
        return _Probability(None, NO_CAMPAIGN)
    for campaign in campaigns:
        if campaign.state is not CampaignState.DONE or not campaign.counts.completed:
            came = f"campaign {campaign.id} is {campaign.state_word}"
            completed = campaign.counts.completed
            return _Probability(None, f"{came}, with {completed:,} completed episodes.")
    if len(campaigns) > 1:
        return _count_together(campaigns, unresolved)
    rate = find_failure_rate(campaigns[0], unresolved)
    if rate is not None and rate.sampled:
        return _read_rate(campaigns[0], rate)
    return _read_estimate(campaigns[0])


def _count_together(campaigns: Sequence[Campaign], unresolved: int) -> _Probability:
    design = SamplingDesign.of_failures(campaigns)
    if not design.is_sampled or design.judges_failures:
        return _Probability(None, ONE_ESTIMATE)
    counts = [each.counts for each in campaigns]
    failures, errored = sum(each.failures for each in counts), sum(each.errored for each in counts)
    completed = sum(each.completed for each in counts)
    share = design.make_rate(failures, completed).value
    return _Probability(FailureShare(failures, errored, completed + errored, share, unresolved))


def _read_rate(campaign: Campaign, rate: Rate) -> _Probability:
    limit = campaign.spec.stop.failures
    # A rule that ended nothing leaves every count below its limit as likely as without it.
    is_unmet = rate.design is RateDesign.FAILURES and limit is not None and rate.k < limit
    if rate.design is RateDesign.FIXED or is_unmet:
        share = FailureShare(rate.k, rate.errored, rate.trials, rate.value, rate.unresolved)
        return _Probability(share)
    # Both bounds are two-sided, also where all episodes failed, and an errored or unresolved
    # episode may have ended either way.
    bounds = SamplingDesign.of_failures([campaign]).find_bounds(rate)
    return _Probability(Stated(rate.value, bounds.low, bounds.high))


def _read_estimate(campaign: Campaign) -> _Probability:
    method, estimate = campaign.spec.method, campaign.estimate
    if not traits_of(method).bounds_probability:
        problem = (
            f"campaign {campaign.id} is a search ('{method}'): it chose its episodes, so that "
            "their failures state no probability. Name one of 'monte_carlo', 'subset', 'mixture' "
            "or 'splitting'."
        )
        return _Probability(None, problem)
    if estimate is None or estimate.problem:
        problem = estimate.problem if estimate else "it gave no estimate."
        return _Probability(None, f"campaign {campaign.id} has no estimate: {problem}")
    if (known := RunEstimate.of(estimate)) is None:
        problem = f"the estimate of campaign {campaign.id} has no interval. {estimate.note}"
        return _Probability(None, problem.strip())
    return _Probability(known)


def _refuse_other_failures(sampled: Campaign, campaigns: Sequence[Campaign], field: str) -> None:
    """Refuse a campaign whose failures do not sample the failures of the scenario."""
    method = sampled.spec.method
    if method != CHAINS and not traits_of(method).draws_from_prior:
        problem = f"campaign {sampled.id} is of '{method}', whose failures are no random sample."
        raise InvalidValue(field, problem, "Name one of 'monte_carlo' or 'chains'.")
    for campaign in campaigns:
        one, other = sampled.spec, campaign.spec
        fields = ("scenario", "scenario_parameters", "simulator", "planner", "planner_settings")
        for name in fields:
            if getattr(one, name) != getattr(other, name):
                problem = f"campaign {sampled.id} has another {name} than campaign {campaign.id}."
                raise InvalidValue(field, problem, "Name a campaign of the same scenario.")
    if sampled.state not in FINAL_STATES:
        problem = f"campaign {sampled.id} is {sampled.state_word}."
        raise InvalidValue(field, problem, "Name a campaign that has ended.")


def _list_notes(
    found: Sequence[Sequence[Campaign]], sampled: Sequence[Sequence[Campaign]]
) -> Iterator[str]:
    """Yield shared seeds and differing requirements or disturbance models, in sentences."""
    seeds = [seed for of_one in found for seed in {each.spec.seed for each in of_one}]
    if len(set(seeds)) < len(seeds):
        yield (
            "Campaigns of several scenarios have the same seed, and so the same noise: the bounds "
            "allow for fully correlated errors. Another seed for each narrows the interval."
        )
    campaigns = [each for of_one in (*found, *sampled) for each in of_one]
    if len({repr(each.spec.all_requirements) for each in campaigns}) > 1:
        yield "A failure is not the same in all campaigns: their requirements differ."
    specs = [each.spec.disturbance for each in campaigns]
    if any(not each.is_like(specs[0]) for each in specs[1:]):
        yield "The campaigns do not have the same disturbance model."


def _count_errored(campaigns: Sequence[Campaign]) -> Iterator[str]:
    """Yield how errored episodes of campaigns that state a probability are counted."""
    errored = sum(each.counts.errored for each in campaigns)
    if errored:
        verb = "counts as a failure" if errored == 1 else "count as failures"
        yield f"{count_noun(errored, 'errored episode')} {verb} in the upper bounds."


def _sum_unresolved(store: Store, campaigns: Sequence[Campaign]) -> int:
    """Return the number of episodes that ended unresolved."""
    return sum(count_unresolved(store, each) for each in campaigns)


def _count_unresolved(store: Store, campaigns: Sequence[Campaign]) -> Iterator[str]:
    """Yield how unresolved episodes of campaigns that state a probability are counted."""
    drawn = [each for each in campaigns if traits_of(each.spec.method).draws_from_prior]
    other = [each for each in campaigns if each not in drawn]
    ended = "ended unresolved: braking could not avoid a collision any more"
    if number := _sum_unresolved(store, drawn):
        yield f"{number:,} episodes {ended}. They count as failures in the upper bounds."
    if number := _sum_unresolved(store, other):
        yield f"{number:,} episodes of other methods than Monte Carlo {ended}. They count as safe."


def _describe_chains(store: Store, sampled: Sequence[Campaign]) -> Iterator[str]:
    """Yield whether the `chains` campaigns behind the severities have mixed."""
    for campaign in sampled:
        if campaign.spec.method != CHAINS:
            continue
        try:
            verdict = find_chain_mixing(store, campaign).verdict
        except (Conflict, ProtocolError) as error:
            verdict = f"Whether its chains have mixed is not known: {error}"
        yield (
            f"Severity from campaign {campaign.id} is that of its failures after burn-in. {verdict}"
        )
