"""Each step of the search is a campaign: created once, found again, and read."""

from collections.abc import Iterator

from msgspec.structs import replace

from eigenfail.client import Client
from eigenfail.errors import ServiceError
from eigenfail.margin.bisection import Step
from eigenfail.suites import Member, Suite
from eigenfail.values import Campaign, CampaignSpec, CampaignState


def step_suite(spec: CampaignSpec, scale: float) -> Suite:
    """The campaign that tries a scale, as a suite of one: it ends with the first failure."""
    name = f"margin of {spec.name}: scale={scale:.10g}"
    tried = replace(
        spec,
        name=name,
        disturbance=replace(spec.disturbance, scale=scale),
        stop=replace(spec.stop, failures=1),
    )
    return Suite(name, (Member(name, tried),))


def known_steps(client: Client, spec: CampaignSpec) -> Iterator[Step]:
    """What the service has tried before for the same question, at whatever scales.

    Raises:
        ServiceUnreachable: no service answers.
    """
    for campaign in client.campaigns.list(CampaignState.DONE):
        scale = campaign.spec.disturbance.scale
        tried = step_suite(spec, scale).members[0].spec
        if campaign.counts.completed and campaign.spec.is_like(tried):
            yield step_of(client, campaign)


def step_of(client: Client, campaign: Campaign) -> Step:
    """What a campaign found at its scale.

    Raises:
        ServiceError: it did not end, or completed no episode, so that it says nothing.
    """
    rate = client.campaigns.summary(campaign.id).failure_rate
    if rate is None or (campaign.state is not CampaignState.DONE and not rate.k):
        came = f"{campaign.state} after {campaign.counts.completed} completed episodes"
        raise ServiceError(
            f"Campaign {campaign.id} is {came} and says nothing of its scale.",
            f"See why: eigenfail campaign show {campaign.id}; then take another seed or budget: "
            "the same question would find the same campaign.",
        )
    return Step(
        scale=campaign.spec.disturbance.scale,
        campaign=campaign.id,
        episodes=rate.n,
        failures=rate.k,
        upper_bound=None if rate.k else rate.interval.high,
    )
