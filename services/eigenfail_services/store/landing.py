"""How results enter the database: a handful of statements, however many results there are."""

from collections.abc import Iterator, Sequence

from sqlalchemy import Connection, bindparam, insert, select

from eigenfail.values import EpisodeResult
from eigenfail.values.records import Delivery, Verdict
from eigenfail_services.store import sentences
from eigenfail_services.store.campaign_rows import locked, write_counts
from eigenfail_services.store.clock import now_ms
from eigenfail_services.store.codec import pack, to_blob
from eigenfail_services.store.events import append
from eigenfail_services.store.judging import Kept, columns_of, judge
from eigenfail_services.store.schema import episodes, scenes, trajectories

CHUNK = 500
"""How many indices one statement names, and how many rows are fetched at a time."""

KNOWN = select(episodes.c["index"], episodes.c.digest).where(
    episodes.c.campaign == bindparam("campaign"),
    episodes.c["index"].in_(bindparam("indices", expanding=True)),
)
EPISODES, TRAJECTORIES, SCENES = insert(episodes), insert(trajectories), insert(scenes)


def land(connection: Connection, campaign: int, deliveries: Sequence[Delivery]) -> list[Verdict]:
    """Keep results, update the counts, and log alarms; one verdict for each delivery.

    Raises:
        NotFound: no such campaign.
    """
    before = locked(connection, campaign)
    known = digests(connection, campaign, {delivery.result.index for delivery in deliveries})
    judgement = judge(before, known, deliveries)
    write(connection, campaign, judgement.kept)
    if judgement.counts != before.counts:
        write_counts(connection, campaign, judgement.counts)
    for alarm in judgement.alarms:
        message = sentences.episode_alarm(campaign, alarm.result.index, alarm.worker)
        append(connection, "episode.alarm", message, campaign)
    return judgement.verdicts


def digests(connection: Connection, campaign: int, indices: set[int]) -> dict[int, str]:
    """Of those of the episodes that have a result."""
    return {
        index: known
        for chunk in chunks(indices)
        for index, known in connection.execute(KNOWN, {"campaign": campaign, "indices": chunk})
    }


def chunks(indices: set[int]) -> Iterator[list[int]]:
    """Some at a time, in order."""
    ordered = sorted(indices)
    for start in range(0, len(ordered), CHUNK):
        yield ordered[start : start + CHUNK]


def write(connection: Connection, campaign: int, kept: Sequence[Kept]) -> None:
    """New rows for results that are kept."""
    if not kept:
        return
    at_ms = now_ms()
    rows = [columns_of(campaign, one, at_ms) | _fault(one.result) for one in kept]
    connection.execute(EPISODES, rows)
    connection.execute(TRAJECTORIES, [_key(campaign, one) | _blobs(one.result) for one in kept])
    seen = [
        _key(campaign, one) | {"scene": pack(one.result.scene)}
        for one in kept
        if one.result.scene is not None
    ]
    if seen:
        connection.execute(SCENES, seen)


def _key(campaign: int, kept: Kept) -> dict[str, object]:
    return {"campaign": campaign, "index": kept.result.index}


def _fault(result: EpisodeResult) -> dict[str, object]:
    fault = result.fault
    return {
        "fault_kind": fault.kind if fault else None,
        "fault_message": fault.message if fault else None,
    }


def _blobs(result: EpisodeResult) -> dict[str, object]:
    return {
        "z": to_blob(result.noise.z),
        "sigma": to_blob(result.noise.sigma),
        "states": None if result.states is None else to_blob(result.states),
    }
