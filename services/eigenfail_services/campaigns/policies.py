"""The policy that a campaign trains, out of its checkpoint."""

from eigenfail.contracts import Store
from eigenfail.errors import NotFound
from eigenfail.values import Campaign, Policy
from eigenfail_services.campaigns.checkpoint import read_checkpoint


def newest_policy(store: Store, campaign: Campaign) -> Policy:
    """The newest version that was handed out.

    Raises:
        NotFound: there is none, or none yet.
        ProtocolError: the checkpoint is one of a newer program.
    """
    state = store.checkpoints.load(campaign.id)
    policy = read_checkpoint(state).policy if state else None
    if policy is None:
        raise NotFound(
            f"Campaign {campaign.id} of method '{campaign.spec.method}' has no policy.",
            "A policy is what 'ast' trains; it is there once the first round is in.",
        )
    return policy
