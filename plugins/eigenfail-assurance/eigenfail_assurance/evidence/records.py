"""The data of solutions: campaigns with their episodes, as files of a bundle.

Episodes are a CSV file as the service exports it, with the columns `COLUMNS`. The digest of a
campaign is computed from the digests of its episodes, again whenever the file is read.
"""

import csv
import io
import re
from base64 import b64decode, b64encode
from binascii import Error as NoBase64
from collections.abc import Iterator, Mapping
from hashlib import sha256
from itertools import pairwise
from typing import Annotated, Any, NamedTuple, TypeVar

import msgspec
import numpy as np

from eigenfail.errors import InvalidValue
from eigenfail.gate.report import GateReport
from eigenfail.values.arrays import Floats
from eigenfail.values.campaign import Campaign
from eigenfail.values.campaign_spec import Settings
from eigenfail.values.episode import MAX_SEED, Outcome
from eigenfail.values.operations import DRAWN_AGAIN, Versions
from eigenfail.values.proof import Proof
from eigenfail_assurance.evidence.question import AnySolution, GateSolution, SensorSolution

COLUMNS = ("index", "seed", "source", "outcome", "steps", "robustness_m", "severity", "digest")

MOST_EPISODES = 1_000_000
"""Episodes of a campaign in a bundle, about 110 bytes each."""

OUTCOMES = {each.word: each for each in Outcome}

Kind = TypeVar("Kind")


def encode_canonical(value: Any) -> bytes:
    """Return a value as compact JSON with sorted keys and a newline: equal for equal values."""
    return msgspec.json.encode(value, order="sorted") + b"\n"


def hash_bytes(content: bytes) -> str:
    """Return the SHA-256 of a file's content, in hexadecimal digits."""
    return sha256(content).hexdigest()


class WorkerVersions(msgspec.Struct, frozen=True, kw_only=True):
    """Versions of the software of workers.

    Attributes:
        workers: names of the workers with these versions.
        versions: by name; empty if the service does not know them any more.
    """

    workers: tuple[str, ...]
    versions: Versions = {}


class PlannerIdentity(msgspec.Struct, frozen=True, kw_only=True):
    """The planner that a campaign tests.

    Attributes:
        name: name of the planner.
        settings: settings that its campaign names; all others are its defaults.
        version: the version that the campaign names; empty if it names none.
    """

    name: str
    settings: Settings
    version: str = ""


class CampaignFacts(msgspec.Struct, frozen=True, kw_only=True):
    """A campaign as the service had it, and the workers that ran it.

    Attributes:
        campaign: the campaign.
        workers: versions of the workers that ran it.
        unresolved: number of its safe episodes that may have ended before a failure, as counted by
            the service: braking could no longer avoid a collision, or this is not known.
    """

    campaign: Campaign
    workers: tuple[WorkerVersions, ...] = ()
    unresolved: Annotated[int, msgspec.Meta(ge=0)] = 0

    @property
    def planner(self) -> PlannerIdentity:
        """The planner under test."""
        spec = msgspec.to_builtins(self.campaign.spec)
        version = spec.get("planner_version") or ""
        return PlannerIdentity(
            name=spec["planner"], settings=spec["planner_settings"], version=str(version)
        )


class RecordedEpisode(msgspec.Struct, frozen=True, gc=False):
    """An episode as a line of its campaign's file.

    Attributes:
        index: its number in the campaign.
        seed: of everything random in it.
        source: of its noise: prior, trajectory or policy.
        outcome: how it ended.
        severity: in m²/s²; None if it has none.
        digest: SHA-256 of what happened.
    """

    index: int
    seed: int
    source: str
    outcome: Outcome
    severity: float | None
    digest: str


class NoiseLine(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Noise of an episode that does not follow from its seed.

    Attributes:
        index: the episode.
        shape: steps and channels.
        z: standardised noise, little-endian float32 in base64. [sigma]
    """

    index: Annotated[int, msgspec.Meta(ge=0)]
    shape: tuple[
        Annotated[int, msgspec.Meta(ge=0, le=100_000)], Annotated[int, msgspec.Meta(ge=1, le=1_000)]
    ]
    z: str

    @classmethod
    def of(cls, index: int, z: Floats) -> "NoiseLine":
        """Return the line of an episode."""
        steps, channels = z.shape
        packed = b64encode(np.ascontiguousarray(z, "<f4").tobytes()).decode()
        return cls(index=index, shape=(steps, channels), z=packed)

    def read(self) -> Floats:
        """Return the noise, shape (steps, channels). [sigma]

        Raises:
            InvalidValue: the text is not base64, or has another size than its shape.
        """
        try:
            found = np.frombuffer(b64decode(self.z, validate=True), "<f4").reshape(self.shape)
        except (NoBase64, ValueError) as error:
            problem = f"the noise of episode {self.index} cannot be read: {error}."
            raise InvalidValue("z", problem) from error
        return found.astype(np.float32)


class CampaignRecord(msgspec.Struct, frozen=True, eq=False, kw_only=True):
    """A campaign with its episodes.

    Attributes:
        facts: the campaign, and what ran it.
        table: its episodes as CSV.
        noise: noise of a sample of the episodes whose noise does not follow from their seeds.
    """

    facts: CampaignFacts
    table: bytes
    noise: tuple[NoiseLine, ...] = ()

    @property
    def campaign(self) -> Campaign:
        """The campaign as the service had it."""
        return self.facts.campaign

    def list_files(self) -> dict[str, bytes]:
        """Return the files of the record by name; the same record has the same files."""
        stem = f"campaigns/{self.campaign.id}"
        files = {f"{stem}.json": encode_canonical(self.facts), f"{stem}.episodes.csv": self.table}
        return files | ({f"{stem}.noise.json": encode_canonical(self.noise)} if self.noise else {})


class SolutionInput(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Data that a solution takes from the service besides its campaigns.

    Attributes:
        campaigns: ids of its campaigns: a group for each scenario of a risk, one group otherwise.
        notes: limitations of the numbers, as reported by the service, in sentences.
        proof: replays of the modes; None for other kinds of solutions, or without an analysis.
        missing: why something could not be read, in sentences; it leaves the solution undecided.
    """

    campaigns: tuple[tuple[int, ...], ...] = ()
    notes: tuple[str, ...] = ()
    proof: Proof | None = None
    missing: tuple[str, ...] = ()


class EvidenceRecords(NamedTuple):
    """Records that the solutions of a question rest on.

    Attributes:
        campaigns: records by id.
        inputs: one for each solution, in the order of `Claim.list_solutions`.
    """

    campaigns: Mapping[int, CampaignRecord]
    inputs: tuple[SolutionInput, ...]


def decode_file(content: bytes, kind: type[Kind], name: str) -> Kind:
    """Return the value in a JSON file of a bundle.

    Raises:
        InvalidValue: it is not of the kind; the error has the name of the file.
    """
    try:
        return msgspec.json.decode(content, type=kind)
    except (ValueError, RecursionError, InvalidValue) as error:
        raise InvalidValue(name, f"cannot be read: {error}.") from error


def read_episodes(table: bytes, name: str) -> tuple[RecordedEpisode, ...]:
    """Return the episodes in a CSV file, in index order.

    Raises:
        InvalidValue: the file has other columns, a value that does not fit its column, or an index
            twice.
    """
    try:
        rows = csv.reader(io.StringIO(table.decode()), strict=True)
        if tuple(next(rows, ())) != COLUMNS:
            raise InvalidValue(name, f"the columns are not {', '.join(COLUMNS)}.")
        episodes = tuple(_read_line(row, number, name) for number, row in enumerate(rows, 2))
    except (UnicodeDecodeError, csv.Error) as error:
        raise InvalidValue(name, f"is not CSV: {error}.") from error
    if any(one.index >= other.index for one, other in pairwise(episodes)):
        raise InvalidValue(name, "the episodes are not in index order.")
    return episodes


def _read_line(row: list[str], number: int, name: str) -> RecordedEpisode:
    try:
        index, seed, source, outcome, _, _, severity, digest = row
        line = RecordedEpisode(
            int(index),
            int(seed),
            source,
            OUTCOMES[outcome],
            float(severity) if severity else None,
            digest,
        )
    except (ValueError, KeyError) as error:
        raise InvalidValue(name, f"line {number} cannot be read: {error}.") from error
    if not (0 <= line.seed <= MAX_SEED and line.index >= 0):
        raise InvalidValue(name, f"line {number}: index or seed is out of bounds.")
    return line


def hash_episodes(episodes: tuple[RecordedEpisode, ...]) -> str:
    """Return the digest of a campaign: SHA-256 of "index digest" of each episode, a line each."""
    lines = sha256()
    for each in episodes:
        lines.update(f"{each.index} {each.digest}\n".encode())
    return lines.hexdigest()


def follows_from_seed(episode: RecordedEpisode) -> bool:
    """Return whether the noise of an episode is drawn from its seed alone."""
    return episode.source == DRAWN_AGAIN


EPISODE = re.compile(r"([1-9][0-9]{0,18})/([0-9]{1,18})")


def list_campaigns(solution: AnySolution, given: SolutionInput) -> list[int]:
    """Return the ids of all campaigns that a solution rests on, each once.

    Raises:
        InvalidValue: an episode of a gate's report is not written as CAMPAIGN/INDEX.
    """
    found = [each for group in given.campaigns for each in group]
    if given.proof is not None:
        same = (each for each in given.proof.scenarios if each.is_same)
        found += [replay.campaign for scenario in same for replay in scenario.replays]
    if isinstance(solution, GateSolution):
        found += _list_gate_campaigns(solution.report)
    if isinstance(solution, SensorSolution):
        found += [each.campaign for each in solution.answer.anchors]
    return sorted(set(found))


def _list_gate_campaigns(report: GateReport) -> Iterator[int]:
    for member in report.members:
        yield from (place_episode(each.episode)[0] for each in member.known if each.episode)
        if member.rerun:
            yield from (each.campaign for each in (member.rerun.before, member.rerun.now))


def place_episode(episode: str) -> tuple[int, int]:
    """Return campaign and index of an episode that is written as CAMPAIGN/INDEX.

    Raises:
        InvalidValue: the episode is not written so.
    """
    match = EPISODE.fullmatch(episode)
    if match is None:
        raise InvalidValue("episode", f"'{episode}' is not of the form CAMPAIGN/INDEX.")
    return int(match[1]), int(match[2])
