"""Starting from the networks of an earlier campaign."""

from eigenfail.errors import InvalidValue
from eigenfail.values import LearnerContext, Predecessor
from eigenfail_services.methods import archive
from eigenfail_services.methods.archive import Arrays
from eigenfail_services.methods.ast.facts import Facts
from eigenfail_services.methods.ast.trainer import Trainer

FIELD = "settings.warm_start"


def begin_from(trainer: Trainer, context: LearnerContext, campaign: int) -> None:
    """Give a new trainer the networks that an earlier campaign ended with.

    Raises:
        InvalidValue: that campaign is not at hand, or its networks are of other shapes.
        ProtocolError: what is at hand is no state of `ast`.
    """
    arrays = networks(predecessor(context, campaign))
    try:
        trainer.adopt(arrays)
    except ValueError as error:
        raise InvalidValue(
            FIELD,
            f"the networks of campaign {campaign} do not fit: {error}.",
            "Use that campaign's `hidden` and `trainer`.",
        ) from error


def networks(before: Predecessor) -> Arrays:
    """The arrays of a learner's last state."""
    _, arrays = archive.read("ast", before.state, Facts)
    return arrays


def predecessor(context: LearnerContext, campaign: int) -> Predecessor:
    """What the context holds of an earlier campaign of `ast`.

    Raises:
        InvalidValue: nothing.
    """
    before = context.predecessor(campaign)
    if before is not None and before.method == "ast":
        return before
    raise InvalidValue(
        FIELD,
        f"the learner of campaign {campaign} is not at hand, or is none of ast.",
        "Name a campaign of ast that has ended.",
    )
