"""Errors that several parts of the store raise, each with its text in one place."""

from datetime import UTC, datetime
from shlex import quote

from eigenfail import errors
from eigenfail.values.campaign import Campaign
from eigenfail.values.operations import DRAWN_AGAIN


def make_episode_error(campaign: int, index: int) -> errors.NotFound:
    """Return the error for an episode without a result."""
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


def make_analysis_error(analysis: int) -> errors.NotFound:
    """Return the error that no analysis has the id."""
    return errors.NotFound(
        f"Analysis {analysis} does not exist.", "`eigenfail analyze` starts one."
    )


def make_mode_error(analysis: int, number: int) -> errors.NotFound:
    """Return the error for a mode that does not exist in an analysis."""
    return errors.NotFound(
        f"Analysis {analysis} has no mode {number}.",
        f"`eigenfail mode list {analysis}` lists them.",
    )


def make_key_error(key: int) -> errors.NotFound:
    """Return the error that no key has the id."""
    return errors.NotFound(f"Key {key} does not exist.", "`eigenfail key list` lists them.")


def format_upgrade_command(address: str) -> str:
    """Return the command that makes or upgrades the schema of the database at an address."""
    return f"eigenfail db upgrade --database {quote(address)}"
