"""Campaigns resolved without the checks that refuse what a service would not launch."""

from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail.worlds import world_of
from eigenfail_services.resolution import (
    ResolvedCampaign,
    find_references,
    find_searching,
    resolve_method,
)


def resolve_campaign(spec: CampaignSpec) -> ResolvedCampaign:
    """Load the method and the scenario of a campaign, and read their settings."""
    method = resolve_method(spec.method, spec.settings)
    form = world_of(spec.simulator).find_form(spec)
    searching = find_searching(method)
    return ResolvedCampaign(spec, form, find_references(searching), method, searching)
