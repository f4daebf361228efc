"""How much the holder of a key may have the service do."""

from typing import Annotated

import msgspec

MOST = 10**15

Limit = Annotated[int, msgspec.Meta(ge=0, le=MOST)] | None


class Quotas(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Bounds on the campaigns that are made with a key; null where there is none.

    Attributes:
        max_open: most campaigns at once that have not ended; queued and paused ones count.
        max_episodes: largest budget of one campaign. [episodes]
        max_episodes_per_day: most episodes in the campaigns of the last 24 hours, by their budgets;
            those that were left unrun when a campaign ended do not count.
    """

    max_open: Limit = None
    max_episodes: Limit = None
    max_episodes_per_day: Limit = None


UNLIMITED = Quotas()


class Usage(msgspec.Struct, frozen=True):
    """What is used of a key's quotas.

    Attributes:
        open: campaigns that have not ended.
        episodes_of_day: in the campaigns of the last 24 hours.
    """

    open: int = 0
    episodes_of_day: int = 0
