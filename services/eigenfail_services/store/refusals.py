"""The errors that every store raises, in one wording."""

from datetime import UTC, datetime
from shlex import quote

from eigenfail.errors import (
    ClaimLost,
    Conflict,
    IdempotencyMismatch,
    NoisePruned,
    NotFound,
    ProtocolError,
)
from eigenfail.values import Campaign
from eigenfail.values.records import Job
from eigenfail.values.retention import DRAWN_AGAIN


def no_campaign(campaign: int) -> NotFound:
    """No campaign has the id."""
    return NotFound(f"There is no campaign {campaign}.", "`eigenfail campaign list` lists them.")


def no_episode(campaign: int, index: int) -> NotFound:
    """The episode has no result."""
    return NotFound(
        f"Episode {index} of campaign {campaign} has no result.",
        "It is still open, was cancelled, or is beyond the campaign's budget.",
    )


def noise_pruned(campaign: int, index: int, source: str, at_ms: int) -> NoisePruned:
    """The noise of an episode was taken away at a time."""
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


def not_ended(campaign: Campaign) -> Conflict:
    """Noise of a campaign is needed as long as it has not ended."""
    return Conflict(
        f"Campaign {campaign.id} is {campaign.state}: its noise cannot be pruned.",
        f"Wait for its end (`eigenfail campaign watch {campaign.id}`), or cancel it.",
    )


def still_needed(campaign: int) -> Conflict:
    """Noise of a campaign is needed by others."""
    return Conflict(
        f"A campaign or an analysis that has not ended needs the noise of campaign {campaign}.",
        "Wait for its end, or cancel it.",
    )


def no_analysis(analysis: int) -> NotFound:
    """No analysis has the id."""
    return NotFound(f"There is no analysis {analysis}.", "`eigenfail analyze` starts one.")


def no_key(key: int) -> NotFound:
    """No key has the id."""
    return NotFound(f"There is no key {key}.", "`eigenfail key list` lists them.")


def claim_lost(claim: Job) -> ClaimLost:
    """The job is no longer that of who wants to write."""
    return ClaimLost(
        f"The {claim.kind} {claim.subject} is somebody else's by now: the lease ran out, or it "
        "was paused, resumed or ended meanwhile.",
        "Nothing is to be done: nothing was written, and whoever has claimed it goes on.",
    )


def damaged_checkpoint(campaign: int) -> ProtocolError:
    """None of a campaign's checkpoints is what was saved."""
    return ProtocolError(
        f"The checkpoint of campaign {campaign} cannot be read: its SHA-256 does not match, and "
        "there is no older one that is whole.",
        "Start the campaign anew.",
    )


def key_used(campaign: int) -> IdempotencyMismatch:
    """The key was used for another spec."""
    return IdempotencyMismatch(
        f"This Idempotency-Key was used for campaign {campaign}, which asks for something else.",
        "Use a new key for a new campaign.",
    )


def upgrade_command(address: str) -> str:
    """The command that makes or upgrades the schema of the database at an address."""
    return f"eigenfail db upgrade --database {quote(address)}"
