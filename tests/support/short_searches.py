"""Searches for failures of `idm` on a road that find some in few episodes, and their end."""

import deadlines

from eigenfail import plugins
from eigenfail.values.campaign import CampaignState

KNOWN = {
    "monte_carlo": (40, {}),
    "held": (40, {}),
    "cem": (40, {"batch": 20}),
    "cma": (40, {}),
    "annealing": (40, {}),
    "optuna": (40, {}),
    "ast": (70, {}),
    "difs": (40, {"round_size": 20}),
    "ensemble": (40, {"method": "held", "members": 2}),
    "subset": (300, {}),
    "mixture": (500, {}),
}
"""Episodes and settings by method."""

KNOWN_CONTINUING = {"go_explore": (40, {})}


def select_installed(searches):
    """Return the searches whose methods are installed: a plug-in may be absent."""
    return {name: searches[name] for name in searches.keys() & {*plugins.names(plugins.METHODS)}}


SEARCHES = select_installed(KNOWN)
CONTINUING = select_installed(KNOWN_CONTINUING)
"""The same of methods that take no scenario whose parameters vary."""


def wait_until_done(client, campaign):
    """Return a campaign once its whole budget was run."""
    ended = client.campaigns.wait(campaign.id, timeout_s=deadlines.CAMPAIGN_S)
    assert ended.state is CampaignState.DONE, ended.stopped_because
    return ended
