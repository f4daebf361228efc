"""The life of a campaign: its states, the moves between them, and what a move changes."""

from collections.abc import Mapping
from datetime import UTC, datetime
from shlex import quote

import msgspec

from eigenfail.errors import (
    ClaimLost,
    Conflict,
    IdempotencyMismatch,
    IllegalTransition,
    NoisePruned,
    NotFound,
    ProtocolError,
)
from eigenfail.values import FINAL_STATES, Campaign, CampaignState, Priority, RunPart
from eigenfail.values.operations import DRAWN_AGAIN, Versions
from eigenfail.values.records import Job

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
the second process to reach it must be refused."""


WITHDRAWN = frozenset({S.PAUSED, S.CANCELLED})
"""What a queued campaign becomes on a user's word; its job leaves the queue with it."""


RESTING = frozenset({S.PAUSING, S.PAUSED})


BY_USER = "A user asked for it."
"""Why most campaigns rest; what else makes one rest stays with it until it goes on."""


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

    In a final state nothing is open: what was, counts as cancelled. A campaign that the service
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
    """Return the campaign as it goes on with these versions; the same object if it has them.

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


def make_campaign_error(campaign: int) -> NotFound:
    """Return the error that no campaign has the id."""
    return NotFound(f"Campaign {campaign} does not exist.", "`eigenfail campaign list` lists them.")


def make_episode_error(campaign: int, index: int) -> NotFound:
    """Return the error that the episode has no result."""
    return NotFound(
        f"Episode {index} of campaign {campaign} has no result.",
        "It is still open, was cancelled, or is beyond the campaign's budget.",
    )


def make_pruned_error(campaign: int, index: int, source: str, at_ms: int) -> NoisePruned:
    """Return the error that the noise of an episode was pruned."""
    day = datetime.fromtimestamp(at_ms / 1_000, UTC).date()
    drawn = (
        f"It follows from the episode's seed: `eigenfail episode replay {campaign}/{index}` draws "
        "it again, and compares."
    )
    chosen = "Its method chose it: it is in backups from before, and nowhere else."
    return NoisePruned(
        f"The noise of episode {campaign}/{index} was pruned on {day}.",
        drawn if source == DRAWN_AGAIN else chosen,
    )


def make_running_error(campaign: Campaign) -> Conflict:
    """Return the error that noise of a campaign is needed until it has ended."""
    return Conflict(
        f"Campaign {campaign.id} is {campaign.state}: its noise cannot be pruned.",
        f"Wait for its end (`eigenfail campaign watch {campaign.id}`), or cancel it.",
    )


def make_needed_error(campaign: int) -> Conflict:
    """Return the error that noise of a campaign is needed by others."""
    return Conflict(
        f"A campaign or an analysis that has not ended needs the noise of campaign {campaign}.",
        "Wait for its end, or cancel it.",
    )


def make_analysis_error(analysis: int) -> NotFound:
    """Return the error that no analysis has the id."""
    return NotFound(f"Analysis {analysis} does not exist.", "`eigenfail analyze` starts one.")


def make_mode_error(analysis: int, number: int) -> NotFound:
    """Return the error that an analysis has no mode of the number."""
    return NotFound(
        f"Analysis {analysis} has no mode {number}.",
        f"`eigenfail mode list {analysis}` lists them.",
    )


def make_key_error(key: int) -> NotFound:
    """Return the error that no key has the id."""
    return NotFound(f"Key {key} does not exist.", "`eigenfail key list` lists them.")


def make_webhook_error(webhook: int) -> NotFound:
    """Return the error that no webhook has the id."""
    return NotFound(f"Webhook {webhook} does not exist.", "`eigenfail webhook list` lists them.")


def make_delivery_error(webhook: int, delivery: int) -> NotFound:
    """Return the error that a webhook has no delivery of the id."""
    return NotFound(
        f"Webhook {webhook} has no delivery {delivery}.",
        f"`eigenfail webhook deliveries {webhook}` lists them.",
    )


def make_claim_error(claim: Job) -> ClaimLost:
    """Return the error that a job was claimed by another process."""
    return ClaimLost(
        f"The {claim.kind} {claim.subject} belongs to another process: the lease ran out, or it "
        "was paused, resumed or ended meanwhile.",
        "No action is needed: nothing was written, and the process that has claimed it goes on.",
    )


def make_checkpoint_error(campaign: int) -> ProtocolError:
    """Return the error that all checkpoints of a campaign are damaged."""
    return ProtocolError(
        f"The checkpoint of campaign {campaign} cannot be read: its SHA-256 does not match, and "
        "there is no older one that is whole.",
        "Launch the campaign again.",
    )


def make_reuse_error(campaign: int) -> IdempotencyMismatch:
    """Return the error that the idempotency key was used for another spec."""
    return IdempotencyMismatch(
        f"This Idempotency-Key was used for campaign {campaign}, which asks for something else.",
        "Use a new key for a new campaign.",
    )


def format_upgrade_command(address: str) -> str:
    """Return the command that makes or upgrades the schema of the database at an address."""
    return f"eigenfail db upgrade --database {quote(address)}"
