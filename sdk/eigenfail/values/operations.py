"""Operation of a service: events, workers and their versions, retention and upkeep."""

from typing import Annotated, Final, Literal

import msgspec

from eigenfail.values.episode import Outcome


class Event(msgspec.Struct, frozen=True):
    """One line of the event log; ids rise without end.

    Attributes:
        kind: campaign.created, campaign.state, campaign.progress, analysis.state, episode.alarm …
        message: one sentence for a person.
        subject: id of the analysis or of the gate that it is about; null for other kinds.
        state: new state of the campaign or the analysis; empty for other kinds.
    """

    id: int
    at_ms: int
    kind: str
    message: str
    campaign: int | None = None
    subject: int | None = None
    state: str = ""


MOST_VERSIONS, LONGEST_NAME = 200, 300


ACTIVE_S = 60
"""A worker that brought a result within this time counts as busy [s]."""


DAY_S = 86_400
"""The longest time that may be asked for."""


Name = Annotated[str, msgspec.Meta(max_length=LONGEST_NAME)]


Versions = Annotated[dict[Name, Name], msgspec.Meta(max_length=MOST_VERSIONS)]
"""By name: of Python, the machine, eigenfail, and every package that a digest depends on."""


class Arrival(msgspec.Struct, frozen=True, kw_only=True):
    """A worker that has come to a hub.

    Attributes:
        worker: its name, as registered with the hub.
        host: the machine that it runs on.
        pid: its process there.
        versions: versions of what it runs with.
    """

    worker: str
    host: str
    pid: int
    versions: Versions = {}


class Presence(Arrival, frozen=True, kw_only=True):
    """Connection period of a worker.

    Attributes:
        id: number of the arrival.
        arrived_ms: when it came; milliseconds since 1970.
        heard_ms: when its hub last said that it is there, which it does every few seconds.
        left_ms: time at which the worker left or was given up; null as long as neither is known.
    """

    id: int
    arrived_ms: int
    heard_ms: int
    left_ms: int | None = None


class Staffing(msgspec.Struct, frozen=True, kw_only=True):
    """How many workers there are, and what the services said last of those that they start.

    Attributes:
        workers: number of connected workers, idle or busy.
        said: such as that workers were asked of Ray and none was placed yet; empty if nothing.
        said_ms: when that was; milliseconds since 1970.
        stranded: what was said of each campaign that no connected worker can run.
    """

    workers: int
    said: str = ""
    said_ms: int | None = None
    stranded: tuple[Event, ...] = ()


class WorkerShare(msgspec.Struct, frozen=True, kw_only=True):
    """Results of one worker for one campaign.

    Attributes:
        worker: its name, as registered with the hub.
        episodes: results of it that were stored.
        failures: failures among them.
        errored: episodes among them that errored.
        wall_s: time that it spent in them. [s]
        last_ms: when the last of them was stored; milliseconds since 1970.
    """

    worker: str
    campaign: int
    episodes: int
    failures: int
    errored: Annotated[int, msgspec.Meta(description="episodes among them that errored.")] = (
        msgspec.field(name="failed")
    )
    wall_s: float
    last_ms: int


class Defect(msgspec.Struct, frozen=True):
    """One thing that is wrong.

    Attributes:
        where: campaign, episode, job or page.
        found: the value in the database, and the expected one.
        remedy: what to do next.
    """

    where: str
    found: str
    remedy: str


class Check(msgspec.Struct, frozen=True):
    """One question to a database.

    Attributes:
        promise: what holds if there is no defect.
        defects: how many there are.
        shown: the first of them.
    """

    name: str
    promise: str
    defects: int
    shown: tuple[Defect, ...]


class Verification(msgspec.Struct, frozen=True):
    """The result of checking a database against its invariants.

    Attributes:
        database: its address, without secrets.
    """

    database: str
    checks: tuple[Check, ...]

    @property
    def defects(self) -> int:
        """How many there are in all."""
        return sum(check.defects for check in self.checks)


class Backup(msgspec.Struct, frozen=True):
    """A backup of a database to a file, or a restoration from one.

    Attributes:
        bytes: size of the file.
        revision: revision of the schema in it.
    """

    database: str
    file: str
    bytes: int
    revision: str


KEEP_EVERY = 100


DRAWN_AGAIN: Final = "prior"
"""The source whose noise follows from an episode's seed, so that nothing is lost with it."""


class Retention(msgspec.Struct, frozen=True):
    """The part of a campaign that stays: its rows, all failures, and every N-th other episode.

    Attributes:
        keep_every: an episode whose index is a multiple of this keeps noise and scene.
        source: source of the noise: prior, trajectory or policy; that of other episodes stays.
    """

    keep_every: Annotated[int, msgspec.Meta(ge=2)] = KEEP_EVERY
    source: Literal["prior", "trajectory", "policy"] = DRAWN_AGAIN

    def takes(self, outcome: Outcome, source: str, index: int) -> bool:
        """Whether an episode's noise goes: only what ran, and ended in no collision."""
        return outcome is Outcome.SAFE and source == self.source and index % self.keep_every != 0


class Weight(msgspec.Struct, frozen=True):
    """How many episodes have noise that may go, and scenes with it, and how large they are."""

    episodes: int = 0
    scenes: int = 0
    bytes: int = 0

    def __add__(self, other: "Weight") -> "Weight":
        """Both together."""
        return Weight(
            self.episodes + other.episodes, self.scenes + other.scenes, self.bytes + other.bytes
        )


class Pruning(msgspec.Struct, frozen=True, kw_only=True):
    """The noise that one command removed from a campaign.

    Attributes:
        id: id of the record.
        retention: rule that says which noise is kept.
        through: the index up to which it has come; it goes in index order.
        pruned_ms: when it began, in milliseconds since 1970.
        who: who gave the command.
        weight: amount of noise that was removed.
    """

    id: int
    campaign: int
    retention: Retention
    through: int
    pruned_ms: int
    who: str
    weight: Weight

    def took(self, outcome: Outcome, source: str, index: int) -> bool:
        """Whether an episode has lost its noise to it, if it was still there."""
        return index <= self.through and self.retention.takes(outcome, source, index)


class PrunedCampaign(msgspec.Struct, frozen=True):
    """The part of one campaign that went, or would go."""

    campaign: int
    name: str
    weight: Weight


class PruneReport(msgspec.Struct, frozen=True):
    """The data that a command took away, or would take away.

    Attributes:
        database: its address, without secrets.
        retention: rule that says which noise is kept.
        is_rehearsal: nothing was changed.
        in_use: campaigns that were passed over, or left before their end: one that has not ended
            needs their noise.
    """

    database: str
    retention: Retention
    is_rehearsal: bool
    campaigns: tuple[PrunedCampaign, ...]
    in_use: tuple[int, ...] = ()

    @property
    def weight(self) -> Weight:
        """Of all campaigns together."""
        return sum((each.weight for each in self.campaigns), Weight())


class Vacuumed(msgspec.Struct, frozen=True):
    """A database whose free room was given back.

    Attributes:
        database: its address, without secrets.
        bytes_before: its size on the disk.
        bytes_after: the same afterwards.
    """

    database: str
    bytes_before: int
    bytes_after: int
