"""Which campaigns are wanted, beside their state."""

import msgspec


class CampaignFilter(msgspec.Struct, frozen=True):
    """What a campaign must be; None where anything will do.

    Attributes:
        method: by its name.
        search: text that its name contains, in small or large letters.
        besides: a method whose campaigns are left out.
    """

    method: str | None = None
    search: str | None = None
    besides: str | None = None


ANY_CAMPAIGN = CampaignFilter()
