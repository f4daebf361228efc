"""Analyses that a gate needs: the first of their kind, made if there is none."""

from collections.abc import Callable

from eigenfail.cli.places import Place
from eigenfail.client import Client
from eigenfail.client.analyses import OVER
from eigenfail.client.waiting import wait_until
from eigenfail.values import Analysis, AnalysisSettings, AnalysisState

POLL_S = 0.3


def analysed_alone(client: Client, place: Place, campaign: int) -> Analysis:
    """The first analysis of a campaign's own failures."""
    return first(client, place, campaign, AnalysisSettings(), lambda each: not each.campaigns)


def analysed_together(client: Client, place: Place, before: int, now: int) -> Analysis:
    """The first analysis of just these two campaigns."""
    settings = AnalysisSettings(campaigns=(now,))
    return first(client, place, before, settings, lambda each: each == settings)


def first(
    client: Client,
    place: Place,
    campaign: int,
    settings: AnalysisSettings,
    is_alike: Callable[[AnalysisSettings], bool],
) -> Analysis:
    """The first analysis of a kind that did not fail, once it has ended; made if there is none.

    The first, so that a gate that is repeated says the same, whatever was analysed since.

    Args:
        client: of the service.
        place: where it is.
        campaign: that is analysed.
        settings: of a new one.
        is_alike: whether one with these settings will do.
    """
    alike = [each for each in client.analyses.list(campaign) if is_alike(each.settings)]
    kept = [each for each in alike if each.state is not AnalysisState.FAILED]
    analysis = kept[-1] if kept else client.analyses.create(campaign, settings)

    def look() -> Analysis:
        place.check()
        return client.analyses.get(analysis.id)

    return wait_until(look, lambda each: each.state in OVER, POLL_S, None)
