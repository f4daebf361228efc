"""What a campaign of `minimal` came to, in words."""

from collections.abc import Iterator

from rich.console import Group, RenderableType
from rich.text import Text

from eigenfail.cli.figures import number
from eigenfail.client import Client
from eigenfail.errors import Conflict
from eigenfail.values import Campaign, MinimalFailure

METHOD = "minimal"


def shrunk(client: Client, campaign: Campaign) -> tuple[str, ...]:
    """The minimal failure of a campaign in sentences; none of a campaign of another method."""
    if campaign.spec.method != METHOD:
        return ()
    try:
        return tuple(minimal_words(client.campaigns.minimal(campaign.id)))
    except Conflict as error:
        return (str(error),)


def minimal_words(found: MinimalFailure) -> Iterator[str]:
    """How much of the noise is needed, what it does, and why there is no more to be left out."""
    yield (
        f"Minimal failure {found.campaign}/{found.index}: {found.needed} of {found.injected} "
        f"values of noise are needed, {share(found)} of their squares."
    )
    yield found.words
    yield found.because
    yield (
        f"log p {number(found.log_probability, 1)} (per step "
        f"{number(found.log_probability_per_step)}); at full strength "
        f"{number(found.full_log_probability, 1)} "
        f"({number(found.full_log_probability_per_step)})."
    )


def share(found: MinimalFailure) -> str:
    """How much of the noise's energy is left."""
    return f"{100.0 * found.energy / found.full_energy:.1f} %" if found.full_energy else "nothing"


def with_words(page: RenderableType, words: tuple[str, ...]) -> RenderableType:
    """A page, and sentences below it."""
    return Group(page, "", *map(Text, words)) if words else page
