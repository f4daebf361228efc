"""Whether a key allows more campaigns: pure."""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

from eigenfail.errors import QuotaExceeded
from eigenfail.values import CampaignSpec
from eigenfail.values.quotas import Quotas, Usage

DAY_MS = 24 * 3_600_000


class Demand(NamedTuple):
    """What a quota is held against.

    Attributes:
        quota: its name.
        limit: how much it allows; None: everything.
        used: what is used of it already.
        more: what is asked for.
        what: what it counts, in words.
        remedy: what gives room.
    """

    quota: str
    limit: int | None
    used: int
    more: int
    what: str
    remedy: str


def refuse_beyond(
    key: int, name: str, quotas: Quotas, usage: Usage, specs: Sequence[CampaignSpec]
) -> None:
    """Let the holder of a key make campaigns.

    Raises:
        QuotaExceeded: it would be more than the key allows; it names the quota.
    """
    for demand in demands(quotas, usage, [spec.episodes for spec in specs]):
        if demand.limit is not None and demand.used + demand.more > demand.limit:
            raise make_refusal(key, name, demand)


def demands(quotas: Quotas, usage: Usage, episodes: Sequence[int]) -> Iterator[Demand]:
    """What campaigns of such budgets ask of each quota."""
    yield Demand(
        *("max_episodes", quotas.max_episodes, 0, max(episodes, default=0)),
        *("episodes in one campaign", "Ask for fewer episodes"),
    )
    yield Demand(
        *("max_open", quotas.max_open, usage.open, len(episodes)),
        *("campaigns at once that have not ended", "Wait until one ends, or cancel one"),
    )
    yield Demand(
        *("max_episodes_per_day", quotas.max_episodes_per_day),
        *(usage.episodes_of_day, sum(episodes)),
        "episodes in the campaigns of 24 hours",
        "Ask for fewer, cancel a campaign that is not needed, or wait",
    )


def make_refusal(key: int, name: str, demand: Demand) -> QuotaExceeded:
    """The refusal: which quota, its limit, what is used, and what to do."""
    command = f"eigenfail key limit {key} --{demand.quota.replace('_', '-')} N"
    return QuotaExceeded(
        f"Key {key} '{name}' may have {demand.limit:,} {demand.what} ({demand.quota}); "
        f"{demand.used:,} are used, and this asks for {demand.more:,}.",
        f"{demand.remedy}. An administrator can allow more: `{command}`.",
    )
