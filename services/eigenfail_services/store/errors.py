"""Errors that several parts of the store raise, each with its text in one place."""

from datetime import UTC, datetime
from shlex import quote

from eigenfail import errors
from eigenfail.values.campaign import Campaign
from eigenfail.values.operations import DRAWN_AGAIN
from eigenfail.values.records import Job


def make_campaign_error(campaign: int) -> errors.NotFound:
    """Return the error that no campaign has the id."""
    return errors.NotFound(
        f"Campaign {campaign} does not exist.", "`eigenfail campaign list` lists them."
    )


def make_episode_error(campaign: int, index: int) -> errors.NotFound:
    """Return the error that the episode has no result."""
    return errors.NotFound(
        f"Episode {index} of campaign {campaign} has no result.",
        "It is still open, was cancelled, or is beyond the campaign's budget.",
    )


def make_pruned_error(campaign: int, index: int, source: str, at_ms: int) -> errors.NoisePruned:
    """Return the error that the noise of an episode was pruned."""
    day = datetime.fromtimestamp(at_ms / 1_000, UTC).date()
    drawn = (
        f"It follows from the episode's seed: `eigenfail episode replay {campaign}/{index}` draws "
        "it again, and compares."
    )
    chosen = "Its method chose it: it is in backups from before, and nowhere else."
    return errors.NoisePruned(
        f"The noise of episode {campaign}/{index} was pruned on {day}.",
        drawn if source == DRAWN_AGAIN else chosen,
    )


def make_running_error(campaign: Campaign) -> errors.Conflict:
    """Return the error that noise of a campaign is needed until it has ended."""
    return errors.Conflict(
        f"Campaign {campaign.id} is {campaign.state}: its noise cannot be pruned.",
        f"Wait for its end (`eigenfail campaign watch {campaign.id}`), or cancel it.",
    )


def make_needed_error(campaign: int) -> errors.Conflict:
    """Return the error that noise of a campaign is needed by others."""
    return errors.Conflict(
        f"A campaign or an analysis that has not ended needs the noise of campaign {campaign}.",
        "Wait for its end, or cancel it.",
    )


def make_analysis_error(analysis: int) -> errors.NotFound:
    """Return the error that no analysis has the id."""
    return errors.NotFound(
        f"Analysis {analysis} does not exist.", "`eigenfail analyze` starts one."
    )


def make_mode_error(analysis: int, number: int) -> errors.NotFound:
    """Return the error that an analysis has no mode of the number."""
    return errors.NotFound(
        f"Analysis {analysis} has no mode {number}.",
        f"`eigenfail mode list {analysis}` lists them.",
    )


def make_key_error(key: int) -> errors.NotFound:
    """Return the error that no key has the id."""
    return errors.NotFound(f"Key {key} does not exist.", "`eigenfail key list` lists them.")


def make_gate_error(gate: int) -> errors.NotFound:
    """Return the error that no result of a gate has the id."""
    return errors.NotFound(f"Gate {gate} does not exist.", "`eigenfail gate list` lists them.")


def make_claim_error(claim: Job) -> errors.ClaimLost:
    """Return the error that a job was claimed by another process."""
    return errors.ClaimLost(
        f"The {claim.kind} {claim.subject} belongs to another process: the lease ran out, or it "
        "was paused, resumed or ended meanwhile.",
        "No action is needed: nothing was written, and the process that has claimed it goes on.",
    )


def make_checkpoint_error(campaign: int) -> errors.ProtocolError:
    """Return the error that all checkpoints of a campaign are damaged."""
    return errors.ProtocolError(
        f"The checkpoint of campaign {campaign} cannot be read: its SHA-256 does not match, and "
        "there is no older one that is whole.",
        "Launch the campaign again.",
    )


def make_reuse_error(campaign: int) -> errors.IdempotencyMismatch:
    """Return the error that the idempotency key was used for another spec."""
    return errors.IdempotencyMismatch(
        f"This Idempotency-Key was used for campaign {campaign}, which asks for something else.",
        "Use a new key for a new campaign.",
    )


def format_upgrade_command(address: str) -> str:
    """Return the command that makes or upgrades the schema of the database at an address."""
    return f"eigenfail db upgrade --database {quote(address)}"
