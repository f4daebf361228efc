"""A campaign over its episodes, block by block: the learning curve of a method that learns."""

from collections.abc import Sequence
from math import ceil

from eigenfail.errors import InvalidValue
from eigenfail.methods import traits_of
from eigenfail.values import BlockTotals, Campaign, Counts, Course, CourseBlock
from eigenfail.values.course import MOST_BLOCKS
from eigenfail_services.statistics.intervals import rate

PER = 100
INTERVALS = 10
BLOCKS_SHOWN = 50


def course(campaign: Campaign, per: int, totals: Sequence[BlockTotals]) -> Course:
    """How failures, their likelihood and robustness moved.

    Args:
        campaign: as it stands.
        per: how many indices a block spans.
        totals: of the blocks that have a completed episode.
    """
    return Course(
        campaign=campaign.id,
        method=campaign.spec.method,
        heading=heading(campaign.spec.method),
        per=per,
        blocks=tuple(block(each, per, campaign.counts.planned) for each in totals),
    )


def block(totals: BlockTotals, per: int, planned: int) -> CourseBlock:
    """One block; the last of a campaign may be shorter."""
    steps = totals.steps
    return CourseBlock(
        first=totals.first,
        last=min(totals.first + per, planned) - 1,
        failure_rate=rate(totals.failures, totals.completed),
        log_probability_per_step=totals.log_probability / steps if steps else None,
        smallest_robustness_m=totals.smallest_robustness_m,
        median_robustness_m=totals.median_robustness_m,
    )


def block_length(counts: Counts, wanted: int | None = None) -> int:
    """How many indices a block spans, from the budget, so that blocks stay as episodes come in.

    Unless told otherwise 100; so many more that there are at most 50 blocks, or so many fewer that
    there are ten. What a campaign left unrun when it ended does not count.

    Raises:
        InvalidValue: so short blocks would be too many.
    """
    reach = max(counts.planned - counts.cancelled, 1)
    if wanted is None:
        return max(min(PER, ceil(reach / INTERVALS)), ceil(reach / BLOCKS_SHOWN))
    least = ceil(counts.planned / MOST_BLOCKS)
    if wanted < least:
        problem = f"{wanted} episodes a block could make more than {MOST_BLOCKS} blocks."
        raise InvalidValue("per", problem, f"Take at least {least}.")
    return wanted


def heading(method: str) -> str:
    """What the course of such a campaign shows."""
    return "Learning curve" if traits_of(method).learns else "Failures over episodes"
