"""Who is there to run episodes, and who ran them."""

from typing import Annotated

import msgspec

from eigenfail.values.event import Event

MOST_VERSIONS, LONGEST_NAME = 200, 300

ACTIVE_S = 60
"""Who brought a result within so many seconds is at work."""

DAY_S = 86_400
"""The longest time that may be asked for."""

Name = Annotated[str, msgspec.Meta(max_length=LONGEST_NAME)]
Versions = Annotated[dict[Name, Name], msgspec.Meta(max_length=MOST_VERSIONS)]
"""By name: of Python, the machine, eigenfail, and every package that a digest depends on."""


class Arrival(msgspec.Struct, frozen=True, kw_only=True):
    """A worker that has come to a hub.

    Attributes:
        worker: its name, as it told the hub.
        host: the machine that it runs on.
        pid: its process there.
        versions: of what it runs with.
    """

    worker: str
    host: str
    pid: int
    versions: Versions = {}


class Presence(Arrival, frozen=True, kw_only=True):
    """A worker, from its arrival until it left.

    Attributes:
        id: number of the arrival.
        arrived_ms: when it came; milliseconds since 1970.
        heard_ms: when its hub last said that it is there, which it does every few seconds.
        left_ms: when it left or was given up; null as long as neither is known.
    """

    id: int
    arrived_ms: int
    heard_ms: int
    left_ms: int | None = None


class Staffing(msgspec.Struct, frozen=True, kw_only=True):
    """How many workers there are, and what the services said last of those that they start.

    Attributes:
        workers: that are connected now, at work or not.
        said: such as that workers were asked of Ray and none was placed yet; empty if nothing.
        said_ms: when that was; milliseconds since 1970.
        stranded: what was said of each campaign that no connected worker can run.
    """

    workers: int
    said: str = ""
    said_ms: int | None = None
    stranded: tuple[Event, ...] = ()


class WorkerShare(msgspec.Struct, frozen=True, kw_only=True):
    """What one worker did for one campaign.

    Attributes:
        worker: its name, as it told the hub.
        episodes: results of it that were stored.
        failures: collisions among them.
        failed: episodes among them that errored.
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
