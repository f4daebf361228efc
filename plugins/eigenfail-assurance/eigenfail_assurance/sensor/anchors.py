"""Anchors of a search for a sensor's limits: campaigns, each created once and found again.

A bound of P(failure) is exact where episodes are drawn from p(x) (Clopper and Pearson 1934,
Biometrika 26, 404-413); such a campaign ends early once its failures show that the target is not
met. Other methods give an estimate with a log-normal interval of 95 %, which is widened to the
confidence of the search.
"""

from bisect import bisect_left
from collections.abc import Callable
from math import ceil, exp, inf, log, log1p, sqrt
from statistics import NormalDist

from msgspec.structs import replace

from eigenfail import intervals
from eigenfail.client import Client
from eigenfail.errors import InvalidValue, ServiceError
from eigenfail.methods import describe_method
from eigenfail.suites import Suite, SuiteMember
from eigenfail.values.campaign import Campaign, CampaignState
from eigenfail.values.campaign_spec import RESULT_RULES, CampaignSpec
from eigenfail.values.estimates import Estimate, Interval
from eigenfail.values.student_t import split_t_mass
from eigenfail_assurance.risk.confidence import find_t_freedom
from eigenfail_assurance.sensor import search
from eigenfail_assurance.sensor.scaling import Multiples, check_channels, scale_model

METHODS = "Take subset or mixture for rare failures, monte_carlo for frequent ones."

LONGEST_ORIGIN = 80
"""Characters of a campaign's name in those of its anchors, which may have no more than 200."""

Run = Callable[[Suite], Campaign]
"""Runs the only campaign of a suite, or goes on with it, and returns it when it is at rest."""


def find_sensor_requirement(
    client: Client, spec: CampaignSpec, question: search.RequirementQuestion, run: Run | None = None
) -> search.RequirementAnswer:
    """Find the largest errors of a sensor at which P(failure) meets a target.

    Campaigns that the service has run for the same question are not run again.

    Args:
        client: client of the service that runs the campaigns.
        spec: the campaign, with the method that bounds P(failure) and the budget of an anchor.
        question: channels, target and budget.
        run: follows a campaign; by default it is waited for in silence.

    Raises:
        UnknownName: a channel, method, setting or parameter that does not exist.
        InvalidValue: a method that bounds no probability, a budget that cannot show the target, a
            channel without a size, an error outside its bounds, or a stop rule on results.
        ServiceError: a campaign did not come to its end, or completed no episode.
    """
    check_question(spec, question)

    def run_silently(suite: Suite) -> Campaign:
        (campaign,) = client.suites.run(suite)
        if campaign is None:
            raise ServiceError(f"There is no campaign '{suite.name}'.")
        return campaign

    def measure(multiples: Multiples, error: float) -> search.Anchor:
        suite = make_anchor_suite(spec, multiples, question.target, error)
        campaign = (run or run_silently)(suite)
        return read_anchor(client, campaign, multiples, question.target, error)

    return search.find_limits(question, measure)


def check_question(spec: CampaignSpec, question: search.RequirementQuestion) -> None:
    """Refuse a campaign that cannot answer a question.

    Raises:
        UnknownName: a channel or method that does not exist.
        InvalidValue: see `find_sensor_requirement`.
    """
    check_channels(spec, question.channels)
    traits = describe_method(spec.method).traits
    if not (traits.draws_from_prior or traits.bounds_probability):
        problem = f"'{spec.method}' gives no estimate of P(failure) with an interval."
        raise InvalidValue("method", problem, METHODS)
    if traits.draws_from_prior:
        _check_budget(spec, question)
    if rules := sorted(spec.stop.given().keys() & RESULT_RULES):
        problem = "the search decides by the results itself when a campaign ends."
        raise InvalidValue(f"stop.{rules[0]}", problem, "Remove this rule.")
    for multiple in (question.within.low, question.within.high):
        scale_model(spec.disturbance, dict.fromkeys(question.channels, multiple))


def _check_budget(spec: CampaignSpec, question: search.RequirementQuestion) -> None:
    error = question.test_error / (question.points if question.has_frontier else 1)
    fewest = ceil(log(error) / log1p(-question.target))
    if spec.episodes < fewest:
        problem = f"{spec.episodes} cannot show a probability of at most {question.target:g}."
        remedy = f"Give {fewest} or more, which show it if none of them fails; or take subset."
        raise InvalidValue("episodes", problem, remedy)


def make_anchor_suite(
    spec: CampaignSpec, multiples: Multiples, target: float, error: float
) -> Suite:
    """Return the campaign of an anchor, as a suite of one member.

    Args:
        spec: the campaign in question.
        multiples: of the errors of its channels.
        target: largest P(failure) that is accepted.
        error: error of each bound.
    """
    member = ", ".join(f"{name} × {multiple:g}" for name, multiple in multiples.items())
    name = f"sensor of {spec.name[:LONGEST_ORIGIN]}: {member}"
    decisive = None
    if describe_method(spec.method).traits.draws_from_prior:
        decisive = find_fewest_failures(target, spec.episodes, error)
    tried = replace(
        spec,
        name=name,
        disturbance=scale_model(spec.disturbance, multiples),
        stop=replace(spec.stop, failures=decisive),
    )
    return Suite(name, (SuiteMember(member, tried),))


def read_anchor(
    client: Client, campaign: Campaign, multiples: Multiples, target: float, error: float
) -> search.Anchor:
    """Read what the campaign of an anchor shows.

    Raises:
        ServiceError: it did not come to its end, or completed no episode.
    """
    counts = campaign.counts
    if campaign.state is not CampaignState.DONE or not counts.completed:
        came = f"{campaign.state_word} after {counts.completed} completed episodes"
        raise ServiceError(
            f"Campaign {campaign.id} is {came}: it bounds no probability.",
            f"See why: eigenfail campaign show {campaign.id}. Then use another seed or budget: "
            "the same search would find the same campaign.",
        )
    problem = ""
    if describe_method(campaign.spec.method).traits.draws_from_prior:
        summary = client.campaigns.summary(campaign.id)
        probability = summary.failure_rate.value if summary.failure_rate else None
        ended = summary.unresolved
        bounds = bound_sampled(campaign, error, ended.count)
    else:
        probability, bounds, problem = _read_estimate(campaign.estimate, error)
    return search.Anchor(
        multiples=dict(multiples),
        campaign=campaign.id,
        episodes=counts.completed,
        failures=counts.failures,
        probability=probability,
        bounds=bounds,
        verdict=search.AnchorVerdict.UNKNOWN if problem else judge_bounds(bounds, target),
        problem=problem,
    )


def judge_bounds(bounds: Interval, target: float) -> search.AnchorVerdict:
    """Return what the bounds of P(failure) show about a target."""
    if bounds.high <= target:
        return search.AnchorVerdict.MET
    return search.AnchorVerdict.NOT_MET if bounds.low > target else search.AnchorVerdict.UNDECIDED


NOTHING_KNOWN = Interval(0.0, 1.0)


def _read_estimate(estimate: Estimate | None, error: float) -> tuple[float | None, Interval, str]:
    """Return the probability, its bounds, and why there are none."""
    if estimate is None or estimate.probability is None:
        problem = estimate.problem if estimate else ""
        return None, NOTHING_KNOWN, problem or "The method gave no estimate."
    if estimate.interval is None or not estimate.cv:
        return estimate.probability, NOTHING_KNOWN, estimate.note or "The estimate has no interval."
    return estimate.probability, bound_estimate(estimate, error), ""


def bound_sampled(campaign: Campaign, error: float, unresolved: int = 0) -> Interval:
    """Return the exact bounds of P(failure) from episodes that were drawn from p(x).

    Errored and unresolved episodes count as failures in the upper bound, and as none in the lower
    one. If the stop rule ended the campaign, the whole budget would have had as many failures
    or more, which gives a lower bound alone.

    Args:
        campaign: a campaign of Monte Carlo.
        error: probability that a bound does not hold.
        unresolved: number of safe episodes that ended while braking could not avoid a collision
            any more, or may have.
    """
    counts, limit = campaign.counts, campaign.spec.stop.failures
    if limit is not None and counts.failures >= limit:
        return Interval(intervals.find_lower_bound(limit, campaign.spec.episodes, error), 1.0)
    trials = counts.completed + counts.errored
    doubtful = min(counts.failures + counts.errored + unresolved, trials)
    return Interval(
        intervals.find_lower_bound(counts.failures, trials, error),
        intervals.find_upper_bound(doubtful, trials, error),
    )


def find_fewest_failures(target: float, episodes: int, error: float) -> int | None:
    """Return the smallest k with P(k or more of n episodes fail) < `error` at the target.

    So many failures show that the target is not met. None if even n of n do not.
    """
    ways = range(1, episodes + 1)
    place = bisect_left(
        ways, True, key=lambda k: 1.0 - intervals.sum_lower_tail(k - 1, episodes, target) < error
    )
    return ways[place] if place < episodes else None


def bound_estimate(estimate: Estimate, error: float) -> Interval:
    """Return bounds of P(failure) from an estimate with a log-normal interval of 95 %.

    Its ends are exp(±q·s) times the estimate, s² = log(1 + cv²), with q of Student's distribution:
    the degrees of freedom follow from the lower end, which is cut nowhere.

    Raises:
        InvalidValue: the estimate lacks an interval.
    """
    if estimate.interval is None or not estimate.cv or not estimate.probability:
        raise InvalidValue("estimate", "it has no interval.", METHODS)
    spread = sqrt(log1p(estimate.cv**2))
    usual = log(estimate.probability / estimate.interval.low) / spread
    factor = exp(spread * _find_quantile(usual, error))
    return Interval(estimate.probability / factor, min(estimate.probability * factor, 1.0))


def _find_quantile(usual: float, error: float) -> float:
    """Return the quantile for a one-sided error of the distribution whose 97.5 % quantile this is.

    It is Student's with 1 or more degrees of freedom, or the normal one.
    """
    freedom = find_t_freedom(usual)
    if freedom == inf:
        return NormalDist().inv_cdf(1.0 - error)
    return exp(
        intervals.find_crossing(
            0.0, 60.0, lambda at: split_t_mass(exp(at), freedom)[1] > 2.0 * error
        )
    )
