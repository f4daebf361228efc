"""The life of a campaign: its states, the moves between them, and what a move changes."""

from collections.abc import Mapping

import msgspec

from eigenfail.errors import IllegalTransition
from eigenfail.values.campaign import FINAL_STATES, Campaign, CampaignState, RunPart
from eigenfail.values.campaign_spec import Priority
from eigenfail.values.operations import Versions

S = CampaignState


MOVES: Mapping[CampaignState, frozenset[CampaignState]] = {
    # Dead without having run: its supervisor was lost every time before it could begin.
    S.QUEUED: frozenset({S.RUNNING, S.PAUSED, S.CANCELLED, S.DEAD}),
    S.RUNNING: frozenset({S.PAUSING, S.CANCELLING, S.DONE, S.DEAD}),
    # A campaign may end by itself before the supervisor has seen what a user asked for: so these
    # states lead to done, too.
    S.PAUSING: frozenset({S.PAUSED, S.CANCELLING, S.RUNNING, S.DONE, S.DEAD}),
    S.PAUSED: frozenset({S.QUEUED, S.CANCELLED}),
    S.CANCELLING: frozenset({S.CANCELLED, S.DONE, S.DEAD}),
    S.CANCELLED: frozenset(),
    S.DONE: frozenset(),
    S.DEAD: frozenset(),
}


REPEATABLE = frozenset({S.QUEUED, S.PAUSING, S.PAUSED, S.CANCELLING, S.CANCELLED})
"""States that a request of a user may reach again. Those that the service reaches (running, done,
dead) are not among them: a second process that reaches one must be refused."""


WITHDRAWN = frozenset({S.PAUSED, S.CANCELLED})
"""States that a user may move a queued campaign to; its job then leaves the queue."""


RESTING = frozenset({S.PAUSING, S.PAUSED})


BY_USER = "A user asked for it."
"""Reason of most pauses; another reason is kept until the campaign is resumed."""


PHRASES: Mapping[CampaignState, str] = {
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
    S.DEAD: "It could not continue.",
}


def _check_move(source: CampaignState, target: CampaignState, who: str = "The campaign") -> None:
    """Refuse a move that `MOVES` does not allow; `REPEATABLE` states may be reached twice.

    Raises:
        IllegalTransition: the move is not allowed; the error names the allowed ones.
    """
    if target in MOVES[source] or (source is target and target in REPEATABLE):
        return
    allowed = ", ".join(sorted(MOVES[source]))
    raise IllegalTransition(
        f"{who} {PHRASES[source]}: it cannot go from {source} to {target}.",
        f"From {source} it can become: {allowed}." if allowed else "Launch a copy of the campaign.",
    )


def move_campaign(campaign: Campaign, to: CampaignState, because: str, at_ms: int) -> Campaign:
    """Return the campaign after a move; the same object if it is in that state already.

    In a final state nothing is open: open episodes count as cancelled. A campaign that the service
    pauses keeps the reason until it goes on.

    Raises:
        IllegalTransition: its state does not allow the move.
    """
    to = S(to)  # the plain word is as good
    _check_move(campaign.state, to, f"Campaign {campaign.id}")
    if campaign.state is to:
        return campaign
    if to in FINAL_STATES:
        return _end_campaign(campaign, to, because or REASONS[to], at_ms)
    begins = to is S.RUNNING and campaign.started_ms is None
    started_ms = at_ms if begins else campaign.started_ms
    paused_because = because if to in RESTING and because != BY_USER else ""
    return msgspec.structs.replace(
        campaign, state=to, started_ms=started_ms, stopped_because=paused_because
    )


def set_priority(campaign: Campaign, priority: Priority) -> Campaign:
    """Return the campaign with another priority; the same object if it has that priority.

    Raises:
        IllegalTransition: it has ended.
    """
    if campaign.state in FINAL_STATES:
        raise IllegalTransition(
            f"Campaign {campaign.id} {PHRASES[campaign.state]}: its priority cannot be changed.",
            "Only one that is queued, at work or paused can be given another priority.",
        )
    if campaign.spec.priority is priority:
        return campaign
    spec = msgspec.structs.replace(campaign.spec, priority=priority)
    return msgspec.structs.replace(campaign, spec=spec)


def set_archived(campaign: Campaign, archived_ms: int | None) -> Campaign:
    """Return the campaign as archived, or as listed again for None; the same object if it is so.

    Raises:
        IllegalTransition: it is to be archived and has not ended.
    """
    if archived_ms is not None and campaign.state not in FINAL_STATES:
        raise IllegalTransition(
            f"Campaign {campaign.id} {PHRASES[campaign.state]}: it cannot be archived.",
            "Wait for its end, or cancel it.",
        )
    if (campaign.archived_ms is None) is (archived_ms is None):
        return campaign
    return msgspec.structs.replace(campaign, archived_ms=archived_ms)


def begin_part(campaign: Campaign, versions: Versions, at_ms: int) -> Campaign:
    """Return the campaign with a part for the versions; the same object if it has them already.

    Before the first result nothing is mixed: only the latest versions are kept.
    """
    if campaign.parts and campaign.parts[-1].versions == versions:
        return campaign
    results = campaign.counts.completed + campaign.counts.errored
    part = RunPart(versions=dict(versions), began_ms=at_ms, results=results)
    earlier = campaign.parts if results else ()
    return msgspec.structs.replace(campaign, parts=(*earlier, part))


def _end_campaign(campaign: Campaign, to: CampaignState, because: str, at_ms: int) -> Campaign:
    counts = campaign.counts
    return msgspec.structs.replace(
        campaign,
        state=to,
        counts=msgspec.structs.replace(counts, cancelled=counts.cancelled + counts.open),
        ended_ms=at_ms,
        stopped_because=because,
    )
