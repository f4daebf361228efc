"""Pause, resume, cancel: what a user asks for, as a step in the life of a campaign."""

from collections.abc import Mapping

import msgspec

from eigenfail.contracts import Store
from eigenfail.errors import IllegalTransition
from eigenfail.values import Campaign, CampaignState

ATTEMPTS = 3


class Wish(msgspec.Struct, frozen=True):
    """What a user may ask of a campaign.

    Attributes:
        steps: from each state that allows it, the state to go to.
        met: states in which it has come true already, or soon will have.
        done: as a participle, for sentences.
    """

    steps: Mapping[CampaignState, CampaignState]
    met: frozenset[CampaignState]
    done: str


PAUSE = Wish(
    steps={
        CampaignState.QUEUED: CampaignState.PAUSED,
        CampaignState.RUNNING: CampaignState.PAUSING,
    },
    met=frozenset({CampaignState.PAUSING, CampaignState.PAUSED}),
    done="paused",
)
RESUME = Wish(
    steps={CampaignState.PAUSED: CampaignState.QUEUED},
    met=frozenset({CampaignState.QUEUED, CampaignState.RUNNING}),
    done="resumed",
)
CANCEL = Wish(
    steps={
        CampaignState.QUEUED: CampaignState.CANCELLED,
        CampaignState.PAUSED: CampaignState.CANCELLED,
        CampaignState.RUNNING: CampaignState.CANCELLING,
        CampaignState.PAUSING: CampaignState.CANCELLING,
    },
    met=frozenset({CampaignState.CANCELLING, CampaignState.CANCELLED}),
    done="cancelled",
)


def steer(store: Store, campaign: int, wish: Wish) -> Campaign:
    """The campaign after the wish; asked twice, it is granted once.

    Raises:
        NotFound: no such campaign.
        IllegalTransition: its state does not allow it.
    """
    for _ in range(ATTEMPTS - 1):
        try:
            return step(store, campaign, wish)
        except IllegalTransition:
            # It may have moved on between the look and the step: look again.
            continue
    return step(store, campaign, wish)


def step(store: Store, campaign: int, wish: Wish) -> Campaign:
    """One look and, if the wish has not come true, one step.

    Raises:
        NotFound: no such campaign.
        IllegalTransition: its state does not allow it, or it moved on after the look.
    """
    seen = store.campaigns.get(campaign)
    if seen.state in wish.met:
        return seen
    target = wish.steps.get(seen.state)
    if target is None:
        raise IllegalTransition(
            f"Campaign {campaign} is {seen.state} and cannot be {wish.done}.",
            f"Only one that is {' or '.join(wish.steps)} can.",
        )
    return store.campaigns.move(campaign, target, "A user asked for it.")
