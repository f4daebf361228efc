"""The mixing of the chains of a campaign, from the last state of its learner."""

from eigenfail import plugins
from eigenfail.errors import Conflict
from eigenfail.values.campaign import Campaign
from eigenfail.values.estimates import ChainMixing
from eigenfail_services.campaigns.rounds import read_checkpoint
from eigenfail_services.methods import Mixing
from eigenfail_services.store import Store


def find_chain_mixing(store: Store, campaign: Campaign) -> ChainMixing:
    """Return how far the chains of a campaign have mixed.

    Raises:
        Conflict: the campaign is one of a method that has no chains or is not installed, or it has
            not finished a round.
        InvalidValue: the method cannot be loaded.
        ProtocolError: its checkpoint cannot be read.
    """
    name = campaign.spec.method
    # A campaign outlives the package of its method, and its page still shows everything else.
    if name not in plugins.names(plugins.METHODS):
        problem = f"Campaign {campaign.id} is one of {name}, which is not installed here."
        raise Conflict(problem, "Install the package of the method where the service runs.")
    method = plugins.load(plugins.METHODS, name)
    if not isinstance(method, Mixing):
        problem = f"Campaign {campaign.id} is one of {name}, which has no chains."
        raise Conflict(problem, "Launch one of chains that starts from its failures.")
    checkpoint = store.checkpoints.load(campaign.id)
    state = read_checkpoint(checkpoint).learner if checkpoint else None
    found = None if state is None else method.judge_mixing(campaign, state)
    if found is None:
        problem = f"No chain of campaign {campaign.id} has started. {campaign.stopped_because}"
        raise Conflict(problem.strip(), "Its first round runs the starts.")
    return found
