"""Something that happened, for whoever follows: dashboard, SDK, command line."""

import msgspec


class Event(msgspec.Struct, frozen=True):
    """One line of the event log; ids rise without end.

    Attributes:
        kind: campaign.created, campaign.state, campaign.progress, analysis.state, episode.alarm …
        message: one sentence for a person.
    """

    id: int
    at_ms: int
    kind: str
    message: str
    campaign: int | None = None
