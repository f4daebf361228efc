"""What a learner is born with: made from the campaign, and from what the store holds."""

from eigenfail.contracts import Store
from eigenfail.values import Campaign, CampaignSpec, LearnerContext, learner_seed
from eigenfail_services.campaigns.checks import horizon
from eigenfail_services.campaigns.earlier import search
from eigenfail_services.campaigns.experience import data_campaigns, experience, stack
from eigenfail_services.campaigns.noise_checks import check_noise, check_replayed
from eigenfail_services.campaigns.predecessors import predecessors
from eigenfail_services.campaigns.recorded_noise import trajectories


def learner_context(campaign: Campaign, store: Store) -> LearnerContext:
    """The context of a campaign's learner.

    Raises:
        InvalidValue: its settings name trajectories, or campaigns to build upon, that are not
            there or of no use.
        NotFound: its settings name an analysis or episode that is not there.
    """
    spec = campaign.spec
    steps = horizon(spec)
    return LearnerContext(
        seed=learner_seed(spec.seed),
        episodes=spec.episodes,
        horizon=steps,
        trajectories=stack(trajectories(search(spec), store), steps),
        predecessors=predecessors(spec, store),
        experience=experience(spec, store),
    )


def check_references(spec: CampaignSpec, store: Store) -> CampaignSpec:
    """The spec itself, once the analysis and campaigns that its settings name can be used.

    Raises:
        InvalidValue: one is not there; or it is to be built upon and has not ended, has learnt
            nothing, or has episodes of another length.
    """
    check_replayed(search(spec), store)
    check_noise(spec, store)
    predecessors(spec, store)
    data_campaigns(spec, store)
    return spec
