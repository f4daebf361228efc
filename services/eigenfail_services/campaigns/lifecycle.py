"""The life of a campaign: its states, the moves between them, and what a move changes."""

from collections.abc import Mapping

import msgspec

from eigenfail.errors import IllegalTransition
from eigenfail.values import FINAL_STATES, Campaign, CampaignState, Priority

S = CampaignState

MOVES: Mapping[CampaignState, frozenset[CampaignState]] = {
    # Dead without having run: its supervisor was lost every time before it could begin.
    S.QUEUED: frozenset({S.RUNNING, S.PAUSED, S.CANCELLED, S.DEAD}),
    S.RUNNING: frozenset({S.PAUSING, S.CANCELLING, S.DONE, S.DEAD}),
    S.PAUSING: frozenset({S.PAUSED, S.CANCELLING, S.RUNNING, S.DONE, S.DEAD}),
    S.PAUSED: frozenset({S.QUEUED, S.CANCELLED}),
    S.CANCELLING: frozenset({S.CANCELLED, S.DONE, S.DEAD}),
    S.CANCELLED: frozenset(),
    S.DONE: frozenset(),
    S.DEAD: frozenset(),
}

REPEATABLE = frozenset({S.QUEUED, S.PAUSING, S.PAUSED, S.CANCELLING, S.CANCELLED})
"""What users ask for may be asked twice. What the service reaches (running, done, dead) may not:
whoever reaches it second was not alone, and must hear of it."""

WITHDRAWN = frozenset({S.PAUSED, S.CANCELLED})
"""What a queued campaign becomes on a user's word; its job leaves the queue with it."""

STORIES: Mapping[CampaignState, str] = {
    S.QUEUED: "waits in the queue",
    S.RUNNING: "is running",
    S.PAUSING: "is about to pause",
    S.PAUSED: "is paused",
    S.CANCELLING: "is being cancelled",
    S.CANCELLED: "was cancelled",
    S.DONE: "is done",
    S.DEAD: "could not go on",
}

REASONS: Mapping[CampaignState, str] = {
    S.CANCELLED: "It was cancelled.",
    S.DONE: "It ran all the episodes that its method asked for.",
    S.DEAD: "It could not go on.",
}


def check(source: CampaignState, target: CampaignState, who: str = "The campaign") -> None:
    """Refuse a move that the table does not have; moves to the same state: see `REPEATABLE`.

    Raises:
        IllegalTransition: with the story so far and the moves that are allowed.
    """
    if target in MOVES[source] or (source is target and target in REPEATABLE):
        return
    allowed = ", ".join(sorted(MOVES[source]))
    raise IllegalTransition(
        f"{who} {STORIES[source]}: it cannot go from {source} to {target}.",
        f"From {source} it can become: {allowed}." if allowed else "Start a campaign like it anew.",
    )


def moved(campaign: Campaign, to: CampaignState, because: str, at_ms: int) -> Campaign:
    """The campaign after a move; the very same object if it is there already.

    In a final state nothing is open: what was, counts as cancelled.

    Raises:
        IllegalTransition: its state does not allow the move.
    """
    to = S(to)  # the plain word is as good
    check(campaign.state, to, f"Campaign {campaign.id}")
    if campaign.state is to:
        return campaign
    if to in FINAL_STATES:
        return _ended(campaign, to, because or REASONS[to], at_ms)
    begins = to is S.RUNNING and campaign.started_ms is None
    started_ms = at_ms if begins else campaign.started_ms
    return msgspec.structs.replace(campaign, state=to, started_ms=started_ms)


def prioritised(campaign: Campaign, priority: Priority) -> Campaign:
    """The campaign with another priority; the very same object if it has that one already.

    Raises:
        IllegalTransition: it has ended.
    """
    if campaign.state in FINAL_STATES:
        raise IllegalTransition(
            f"Campaign {campaign.id} {STORIES[campaign.state]}: no priority can change that.",
            "Only one that is queued, at work or paused can be given another priority.",
        )
    if campaign.spec.priority is priority:
        return campaign
    spec = msgspec.structs.replace(campaign.spec, priority=priority)
    return msgspec.structs.replace(campaign, spec=spec)


def _ended(campaign: Campaign, to: CampaignState, because: str, at_ms: int) -> Campaign:
    counts = campaign.counts
    return msgspec.structs.replace(
        campaign,
        state=to,
        counts=msgspec.structs.replace(counts, cancelled=counts.cancelled + counts.open),
        ended_ms=at_ms,
        stopped_because=because,
    )
