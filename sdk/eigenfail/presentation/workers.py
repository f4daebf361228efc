"""Workers of a service, connected or gone, with their latest work."""

from collections import defaultdict
from collections.abc import Iterable, Sequence
from enum import StrEnum

import msgspec

from eigenfail.values.operations import Presence, WorkerShare

PACKAGE, PROCESSOR = "eigenfail", "processor"
"""Names of versions that lists of workers show."""


class WorkerState(StrEnum):
    """The present work of a worker."""

    AT_WORK = "at work"
    WAITING = "waiting"
    GONE = "gone"


class WorkerActivity(msgspec.Struct, frozen=True, kw_only=True):
    """The latest work of a worker; only results within the requested time count.

    Attributes:
        worker: its name; a worker without a name has its host and process as its name.
        host: the machine that it runs on; empty if it is not connected now.
        version: version of its eigenfail; empty likewise.
        state: gone if it is not connected; at work if it brought a result in the last minute.
        campaigns: campaigns that it ran episodes of.
        since_ms: when it connected; milliseconds since 1970, null if it is not connected now.
        last_ms: when its last result was stored; null before the first one.
        processor: processor of its machine; empty if it is not connected now.
        heard_ms: when its hub last reported it as connected; null if it is not connected now.
    """

    worker: str
    host: str
    version: str
    state: WorkerState
    campaigns: tuple[int, ...]
    episodes: int
    failures: int
    errored: int = msgspec.field(name="failed")
    since_ms: int | None
    last_ms: int | None
    processor: str = ""
    heard_ms: int | None = None


def combine_activity(
    present: Iterable[Presence], recent: Iterable[WorkerShare], at_work: Iterable[WorkerShare]
) -> tuple[WorkerActivity, ...]:
    """Return the workers that are connected or had results, latest results first.

    Args:
        present: workers that are connected now.
        recent: results of workers within the requested time.
        at_work: results of workers within the last minute.
    """
    here = {presence.worker: presence for presence in present}
    busy = {share.worker for share in at_work}
    # Connected workers are listed even if they have no results yet.
    shares = defaultdict[str, list[WorkerShare]](list, {name: [] for name in here})
    for share in recent:
        shares[share.worker].append(share)
    found = [
        summarize_activity(name, theirs, here.get(name), is_at_work=name in busy)
        for name, theirs in shares.items()
    ]
    # By name, too: workers without results would change places each time the list is drawn.
    return tuple(sorted(found, key=lambda each: (-(each.last_ms or 0), each.worker)))


def summarize_activity(
    name: str, shares: Sequence[WorkerShare], here: Presence | None, *, is_at_work: bool
) -> WorkerActivity:
    """Return the work of one worker, for all campaigns together."""
    connected = WorkerState.AT_WORK if is_at_work else WorkerState.WAITING
    return WorkerActivity(
        worker=name,
        host=here.host if here else "",
        version=here.versions.get(PACKAGE, "") if here else "",
        state=connected if here else WorkerState.GONE,
        campaigns=tuple(sorted(share.campaign for share in shares)),
        episodes=sum(share.episodes for share in shares),
        failures=sum(share.failures for share in shares),
        errored=sum(share.errored for share in shares),
        since_ms=here.arrived_ms if here else None,
        last_ms=max((share.last_ms for share in shares), default=None),
        processor=here.versions.get(PROCESSOR, "") if here else "",
        heard_ms=here.heard_ms if here else None,
    )
