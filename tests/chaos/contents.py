"""What the rows hold: numbers against their digests, checkpoints against their hashes."""

import hashlib
import math
import struct
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

import msgspec

FIRST_MEASURES = 4
MEASURES = (
    *("robustness_m", "severity", "min_ttc_s", "max_drac_mps2", "ttc_violated_s"),
    *("drac_violated_s", "drac_at_warning_mps2", "collided_s", "left_road_s", "max_jerk_mps3"),
    *("hard_brakings", "clipped_steps"),
)
NUMBERS = (*MEASURES, "log_probability", "wall_s")
BYTES_PER_STEP = 8
NOTHING = math.nan


class Noise(msgspec.Struct, frozen=True):
    """Of a spec's disturbance, its shape as it stands there."""

    shape: msgspec.Raw = msgspec.Raw(b'{"kind":"white"}')


class Spec(msgspec.Struct, frozen=True):
    """What is read of a spec."""

    seed: int
    episodes: int
    disturbance: Noise = Noise()


class Kind(msgspec.Struct, frozen=True):
    """Of a shape, what it is called."""

    kind: str


def digest_of(rows: Iterable[Any]) -> str:
    """SHA-256 over one line "index digest" for each result, in index order."""
    return hashlib.sha256("".join(f"{i} {known}\n" for i, known in rows).encode()).hexdigest()


def in_campaign(row: Mapping[str, Any], digest: str) -> Iterator[str]:
    """What a campaign's row says that is not so."""
    spec = msgspec.json.decode(row["spec"], type=Spec)
    if spec.episodes != row["planned"]:
        yield f"P1: campaign {row['id']} asks for {spec.episodes} and plans {row['planned']}."
    if (row["digest"] is None) != (row["state"] != "done"):
        yield f"P4: campaign {row['id']} is {row['state']}, and its digest is {row['digest']}."
    if row["digest"] not in {None, digest}:
        yield f"P4: campaign {row['id']} has another digest than its rows."


def in_episode(row: Mapping[str, Any], spec: str) -> Iterator[str]:
    """What an episode's row says that is not so."""
    name = f"episode {row['campaign']}/{row['index']}"
    if any(row[number] is not None and not math.isfinite(row[number]) for number in NUMBERS):
        yield f"P4: {name} has a number that is none."
    if len(row["z"]) % BYTES_PER_STEP or len(row["z"]) != len(row["sigma"]):
        yield f"P4: {name} has noise that is cut short."
    if row["digest"] != episode_digest(row, spec):
        yield f"P4: {name} is not what was delivered: its digest is another."
    if row["scene"] is not None and not is_table(row["scene"]):
        yield f"P9: {name} has a scene that is no plain data."


def episode_digest(row: Mapping[str, Any], spec: str) -> str:
    """SHA-256 over outcome, steps, measures and noise, as in docs/concepts.md."""
    shape = msgspec.json.decode(spec, type=Spec).disturbance.shape
    parts = [row["outcome"].encode(), struct.pack("<q", row["steps"]), measures(row)]
    parts += [bytes(row["z"]), bytes(row["sigma"]), (row["fault_kind"] or "").encode()]
    if row["z"] and msgspec.json.decode(shape, type=Kind).kind != "white":
        parts.append(bytes(shape))
    return hashlib.sha256(b"\x00".join(parts)).hexdigest()


def measures(row: Mapping[str, Any]) -> bytes:
    """Little-endian doubles; what is None at the end does not count beyond the fourth."""
    measured = row["robustness_m"] is not None
    numbers = [row[name] if measured else None for name in MEASURES]
    while len(numbers) > FIRST_MEASURES and numbers[-1] is None:
        numbers.pop()
    return struct.pack(f"<{len(numbers)}d", *(NOTHING if n is None else n for n in numbers))


def in_checkpoint(row: Mapping[str, Any], spec: str) -> Iterator[str]:
    """What is wrong with a checkpoint."""
    name, state = f"checkpoint {row['number']} of campaign {row['campaign']}", bytes(row["state"])
    if row["sha256"] != hashlib.sha256(state).hexdigest():
        yield f"P5: {name} is not what was saved."
    if not is_table(state):
        yield f"P5: {name} cannot be read."
        return
    found, asked = msgspec.msgpack.decode(state), msgspec.json.decode(spec, type=Spec)
    if (found.get("campaign_seed"), found.get("budget")) != (asked.seed, asked.episodes):
        yield f"P5: {name} is of another one."
    if not 0 <= found.get("episodes", -1) <= asked.episodes:
        yield f"P5: {name} has proposed {found.get('episodes')} of {asked.episodes} episodes."
    if not is_whole(found.get("learner", b"")):
        yield f"P5: {name} holds a learner whose SHA-256 does not match."


def is_whole(learner: bytes) -> bool:
    """Whether a learner's state has the hash that is written on it, if there is one."""
    archive = msgspec.msgpack.decode(learner) if is_table(learner) else {}
    if not {"sha256", "body"} <= set(archive):
        return True
    return bool(hashlib.sha256(archive["body"]).digest() == archive["sha256"])


def is_table(data: bytes) -> bool:
    """Whether the bytes are MessagePack of a mapping, with nothing in it but plain data."""
    try:
        return isinstance(msgspec.msgpack.decode(data, ext_hook=refuse), dict)
    except (msgspec.DecodeError, ValueError):
        return False


def refuse(code: int, _data: memoryview) -> None:
    """Extension types could stand for anything."""
    raise ValueError(f"extension type {code}")
