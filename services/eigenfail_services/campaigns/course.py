"""The course of a campaign, from what the store holds of it."""

from eigenfail.contracts import Store
from eigenfail.values import Campaign, Course
from eigenfail_services.analysis.course import block_length, course


def course_of(store: Store, campaign: Campaign, per: int | None = None) -> Course:
    """How failures, their likelihood and robustness moved over the episodes so far.

    Args:
        store: where the episodes are.
        campaign: as it stands.
        per: how many indices a block spans; None chooses by the budget.

    Raises:
        InvalidValue: so short blocks would be too many.
    """
    length = block_length(campaign.counts, per)
    return course(campaign, length, store.episodes.course(campaign.id, length))
