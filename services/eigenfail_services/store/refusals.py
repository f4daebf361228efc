"""The errors that every store raises, in one wording."""

from eigenfail.errors import IdempotencyMismatch, NotFound


def no_campaign(campaign: int) -> NotFound:
    """No campaign has the id."""
    return NotFound(f"There is no campaign {campaign}.", "`eigenfail campaign list` lists them.")


def no_episode(campaign: int, index: int) -> NotFound:
    """The episode has no result."""
    return NotFound(
        f"Episode {index} of campaign {campaign} has no result.",
        "It is still open, was cancelled, or is beyond the campaign's budget.",
    )


def no_analysis(analysis: int) -> NotFound:
    """No analysis has the id."""
    return NotFound(f"There is no analysis {analysis}.", "`eigenfail analyze` starts one.")


def no_key(key: int) -> NotFound:
    """No key has the id."""
    return NotFound(f"There is no key {key}.", "`eigenfail key list` lists them.")


def key_used(campaign: int) -> IdempotencyMismatch:
    """The key was used for another spec."""
    return IdempotencyMismatch(
        f"This Idempotency-Key was used for campaign {campaign}, which asks for something else.",
        "Use a new key for a new campaign.",
    )
