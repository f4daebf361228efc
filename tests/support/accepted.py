"""Campaigns to be created in a test without the checks that refuse what no service would launch."""

from collections.abc import Iterable
from contextlib import suppress

from eigenfail.errors import EigenfailError
from eigenfail.values.campaign import EpisodeForm
from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail.worlds import world_of
from eigenfail_services.resolution import (
    CampaignReferences,
    CheckedCampaign,
    find_references,
    find_searching,
    resolve_method,
)


def accept_spec(spec: CampaignSpec) -> CheckedCampaign:
    """Return a campaign with what can be found about it: its plug-ins need not exist."""
    form, references = EpisodeForm(), CampaignReferences()
    with suppress(EigenfailError):
        form = world_of(spec.simulator).find_form(spec)
    with suppress(EigenfailError):
        references = find_references(find_searching(resolve_method(spec.method, spec.settings)))
    return CheckedCampaign(spec, form, references)


def accept_specs(specs: Iterable[CampaignSpec]) -> list[CheckedCampaign]:
    """Return campaigns with what can be found about each, in order."""
    return list(map(accept_spec, specs))
