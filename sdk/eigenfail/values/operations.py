"""Operation of a service: events, workers and their versions, retention and upkeep."""

from typing import Annotated, Final, Literal

import msgspec

from eigenfail.values.episode import Outcome


class Event(msgspec.Struct, frozen=True):
    """A line of the event log; ids always increase.

    Attributes:
        kind: campaign.created, campaign.state, campaign.progress, analysis.state, episode.alarm …
        message: description of the event in a sentence.
        subject: id of the analysis or gate that the event concerns; null for other kinds.
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
"""The longest time that a caller may request. [s]"""


Name = Annotated[str, msgspec.Meta(max_length=LONGEST_NAME)]


Versions = Annotated[dict[Name, Name], msgspec.Meta(max_length=MOST_VERSIONS)]
"""Versions by name: Python, the machine, eigenfail, and every package that a digest depends on."""


class Arrival(msgspec.Struct, frozen=True, kw_only=True):
    """Arrival of a worker at a hub.

    Attributes:
        worker: name of the worker, as registered with the hub.
        host: machine that the worker runs on.
        pid: id of its process on that machine.
        versions: versions of the software that the worker runs with.
    """

    worker: str
    host: str
    pid: int
    versions: Versions = {}


class Presence(Arrival, frozen=True, kw_only=True):
    """Connection period of a worker.

    Attributes:
        id: number of the arrival.
        arrived_ms: when the worker arrived; milliseconds since 1970.
        heard_ms: when the hub last reported the worker, which it does every few seconds.
        left_ms: when the worker left or was given up; null until one of them is known.
    """

    id: int
    arrived_ms: int
    heard_ms: int
    left_ms: int | None = None


class Staffing(msgspec.Struct, frozen=True, kw_only=True):
    """Number of workers, and the services' latest message on the workers that they start.

    Attributes:
        workers: number of connected workers, idle or busy.
        said: the message, such as that Ray has not yet placed any requested worker; empty without
            one.
        said_ms: time of the message; milliseconds since 1970.
        stranded: event for each campaign that no connected worker can run.
    """

    workers: int
    said: str = ""
    said_ms: int | None = None
    stranded: tuple[Event, ...] = ()


class WorkerShare(msgspec.Struct, frozen=True, kw_only=True):
    """Results of one worker for one campaign.

    Attributes:
        worker: name of the worker, as registered with the hub.
        episodes: number of its stored results.
        failures: number of failures among them.
        errored: episodes among them that errored.
        wall_s: time that the worker spent on them. [s]
        last_ms: when its last result was stored; milliseconds since 1970.
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
    """A defect in a database.

    Attributes:
        where: campaign, episode, job or page.
        found: the value in the database, and the expected one.
        remedy: what to do next.
    """

    where: str
    found: str
    remedy: str


class Check(msgspec.Struct, frozen=True):
    """A check of a database.

    Attributes:
        promise: statement that is true without defects.
        defects: number of defects.
        shown: the first defects.
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
        """Number of defects of all checks."""
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
"""Source whose noise follows from the episode's seed, so that it can be drawn again."""


class Retention(msgspec.Struct, frozen=True):
    """Rule for the data that a campaign keeps: rows, all failures, every N-th safe episode.

    Attributes:
        keep_every: an episode whose index is a multiple of this number keeps noise and scene.
        source: source of the noise to remove: prior, trajectory or policy. Episodes with other
            sources keep their noise.
    """

    keep_every: Annotated[int, msgspec.Meta(ge=2)] = KEEP_EVERY
    source: Literal["prior", "trajectory", "policy"] = DRAWN_AGAIN

    def takes(self, outcome: Outcome, source: str, index: int) -> bool:
        """Return whether the rule removes an episode's noise; only safe episodes lose theirs."""
        return outcome is Outcome.SAFE and source == self.source and index % self.keep_every != 0


class Weight(msgspec.Struct, frozen=True):
    """Number of episodes and scenes with removable noise, and the size of this data."""

    episodes: int = 0
    scenes: int = 0
    bytes: int = 0

    def __add__(self, other: "Weight") -> "Weight":
        """Return the sum of both."""
        return Weight(
            self.episodes + other.episodes, self.scenes + other.scenes, self.bytes + other.bytes
        )


class Pruning(msgspec.Struct, frozen=True, kw_only=True):
    """The noise that one command removed from a campaign.

    Attributes:
        id: id of the record.
        retention: rule that selects the noise to keep.
        through: last index processed so far; episodes are processed in index order.
        pruned_ms: when the removal began, in milliseconds since 1970.
        who: user who gave the command.
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
        """Return whether an episode that still had its noise has lost it to this command."""
        return index <= self.through and self.retention.takes(outcome, source, index)


class PrunedCampaign(msgspec.Struct, frozen=True):
    """Data of one campaign that a command removed, or would remove."""

    campaign: int
    name: str
    weight: Weight


class PruneReport(msgspec.Struct, frozen=True):
    """Data that a command removed, or would remove.

    Attributes:
        database: address of the database, without secrets.
        retention: rule that selects the noise to keep.
        is_rehearsal: whether the command only lists data and changes nothing.
        in_use: campaigns that were skipped, or left before their end, because a campaign that has
            not ended needs their noise.
    """

    database: str
    retention: Retention
    is_rehearsal: bool
    campaigns: tuple[PrunedCampaign, ...]
    in_use: tuple[int, ...] = ()

    @property
    def weight(self) -> Weight:
        """Amount of data of all campaigns together."""
        return sum((each.weight for each in self.campaigns), Weight())


class Vacuumed(msgspec.Struct, frozen=True):
    """A database whose free space was released.

    Attributes:
        database: its address, without secrets.
        bytes_before: size on disk before. [bytes]
        bytes_after: size on disk afterwards. [bytes]
    """

    database: str
    bytes_before: int
    bytes_after: int
