"""Campaigns on functions of modules that are not listed here: they rest, and say what to do."""

from eigenfail import functions
from eigenfail.contracts import Store
from eigenfail.errors import ClaimLost, IllegalTransition, InvalidValue
from eigenfail.values import Campaign, CampaignState
from eigenfail.values.records import Job

S = CampaignState
AFTER = {S.PAUSING: S.PAUSED, S.CANCELLING: S.CANCELLED}


def may_run(campaign: Campaign, job: Job, store: Store) -> bool:
    """Whether a claimed campaign may run here; one that may not is set aside."""
    if campaign.spec.simulator != functions.SIMULATOR:
        return True
    try:
        functions.refuse_unlisted(campaign.spec.planner)
    except InvalidValue as error:
        set_aside(campaign, job, store, f"{error} Then: eigenfail campaign resume {campaign.id}.")
        return False
    return True


def set_aside(campaign: Campaign, job: Job, store: Store, because: str) -> None:
    """Pause it, or cancel it if a user asked for that.

    In the queue it would be claimed again and again, until it is buried.
    """
    move, state = store.campaigns.move, campaign.state
    try:
        if state is S.RUNNING:
            state = move(campaign.id, S.PAUSING, because, job).state
        move(campaign.id, AFTER.get(state, S.PAUSED), because, job)
    except (IllegalTransition, ClaimLost):  # somebody asked for something else since we looked
        store.jobs.renew(job, 0.0)
        return
    store.jobs.finish(job)
