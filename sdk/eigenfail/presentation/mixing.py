"""Sentences and a table that say how far chains of failures have mixed."""

from eigenfail.presentation.figures import format_count, format_share
from eigenfail.presentation.tables import Block, Table, TableColumn
from eigenfail.values.mixing import ChainMixing


def describe_chain_mixing(found: ChainMixing) -> tuple[Block, ...]:
    """Return the verdict on the chains of a campaign, and its reasons by projection."""
    share = format_share(found.accepted / found.moves if found.moves else None)
    others = "" if found.started == found.chains else " The others began where these did."
    accepted = f"{format_count(found.accepted)} of {format_count(found.moves)}"
    first = f"{found.campaign}/{found.first_sample}"
    sentences = (
        f"Chains: the starts of {found.started} of {found.chains} failed.{others}",
        f"Samples: {accepted} moves after burn-in failed ({share}), from episode {first} on.",
        found.verdict,
        found.remark,
    )
    if not found.projections:
        return sentences
    table = Table(
        "Mixing",
        (
            TableColumn("Projection", is_figure=False),
            TableColumn("R-hat"),
            TableColumn("Effective samples"),
        ),
        tuple((one.name, one.r_hat, one.effective) for one in found.projections),
    )
    return (*sentences, table)
