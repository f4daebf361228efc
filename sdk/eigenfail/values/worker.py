"""Who ran the episodes."""

import msgspec


class WorkerShare(msgspec.Struct, frozen=True, kw_only=True):
    """What one worker did for one campaign.

    Attributes:
        worker: its name, as it told the hub.
        episodes: results of it that were stored.
        failures: collisions among them.
        failed: episodes among them that could not be run.
        wall_s: time that it spent in them. [s]
        last_ms: when the last of them was stored; milliseconds since 1970.
    """

    worker: str
    campaign: int
    episodes: int
    failures: int
    failed: int
    wall_s: float
    last_ms: int
