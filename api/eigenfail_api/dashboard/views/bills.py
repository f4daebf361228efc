"""What the campaigns of one side cost together, and what their time went into."""

from collections.abc import Sequence

from eigenfail.values import CampaignCost
from eigenfail_api.dashboard import formats
from eigenfail_api.dashboard.views.spending import PARTS

NAMES = (
    "Spent [USD]",
    "USD per distinct mode",
    *(f"Time: {name.lower()}" for name in PARTS),
)
ONE_AT_A_TIME = "of one campaign at a time"


def bill(costs: Sequence[CampaignCost]) -> tuple[str, ...]:
    """The figures of a side, in the order of `NAMES`."""
    spent = formats.number(sum(cost.cost.total_usd for cost in costs))
    return (spent, per_mode(costs), *(share(costs, part) for part, _ in PARTS.values()))


def per_mode(costs: Sequence[CampaignCost]) -> str:
    """Of a single campaign: the modes of several may be the same ones."""
    return formats.number(costs[0].per_mode_usd) if len(costs) == 1 else ONE_AT_A_TIME


def share(costs: Sequence[CampaignCost], part: str) -> str:
    """A part of the time of all of them; a dash where one of them did not measure it."""
    active_s = sum(cost.time.active_s for cost in costs)
    known = [part_s for cost in costs if (part_s := getattr(cost.time, part)) is not None]
    if len(known) < len(costs) or active_s <= 0.0:
        return formats.NONE
    return f"{100.0 * sum(known) / active_s:.1f} % ({formats.duration(sum(known))})"
