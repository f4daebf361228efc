"""Messages between hub, workers and learners, their encoding, and pieces of long messages.

Messages are tagged structs in MessagePack; arrays are a shape and little-endian float32 bytes.
Bytes that do not decode raise only ProtocolError: messages cannot make the receiver run code.
"""

from collections.abc import Iterator
from hashlib import sha256
from itertools import count
from typing import Annotated, Any

import msgspec

from eigenfail.bridges import BridgeOffer
from eigenfail.errors import ProtocolError
from eigenfail.values.arrays import Floats, PackedArray, encode_array, unpack
from eigenfail.values.campaign_spec import StopRules
from eigenfail.values.episode import EpisodeResult, EpisodeSetup, EpisodeTask
from eigenfail.values.estimates import Estimate
from eigenfail.values.learning import LearnerContext, Policy, Round
from eigenfail.values.operations import Name, Versions

PROTOCOL = 8
"""Version of the protocol: increases with each change that an older peer would not understand."""

MAX_MESSAGE_BYTES = 256 * 1024 * 1024
LONGEST_LIFE = 64
LARGEST_PID = 2**31 - 1
LONGEST_REASON = 2_000

MAX_HOLDINGS = 4_096
"""Largest number of episodes that a worker may name at a time: many times what it is leased."""

FINGERPRINT_BYTES = 16

_Natural = Annotated[int, msgspec.Meta(ge=0)]
_Fingerprint = Annotated[bytes, msgspec.Meta(max_length=FINGERPRINT_BYTES)]

FINISHED = b""
"""Fingerprint of a task that is finished: its result follows, and is judged like any other."""

# In a fixed order: equal settings must have equal fingerprints, however a file was written.
_task_encoder = msgspec.msgpack.Encoder(enc_hook=encode_array, order="deterministic")


class Holding(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """An episode that a worker already holds, and the fingerprint of its task."""

    campaign: _Natural
    index: _Natural
    task: _Fingerprint = FINISHED


def fingerprint_task(setup: EpisodeSetup, task: EpisodeTask) -> bytes:
    """Return a fingerprint that two tasks share if and only if their results are the same.

    It covers everything that an episode depends on: setup, index, seed and source. A policy counts
    by its version alone, which is a function of the campaign's seed and earlier rounds.
    """
    return sha256(_task_encoder.encode((setup, task))).digest()[:FINGERPRINT_BYTES]


def is_same_task(one: EpisodeTask, other: EpisodeTask) -> bool:
    """Return whether two tasks of one campaign have the same result."""
    return _task_encoder.encode(one) == _task_encoder.encode(other)


_Reason = Annotated[str, msgspec.Meta(max_length=LONGEST_REASON)]


class Message(msgspec.Struct, frozen=True, eq=False, tag=True, forbid_unknown_fields=True):
    """Base of all messages."""


class Hello(Message, frozen=True):
    """Worker to hub: request to join, with room for `credit` episodes at a time.

    Attributes:
        life: random name of the worker's process, the same on each of its connections.
        asked: number of the request. A worker repeats its hello until it is welcomed; repeated
            hellos have the same number and the same contents.
        holdings: episodes that it already holds: leased but not begun, running, or finished but not
            acknowledged.
        versions: versions of the packages that run its episodes.
        bridge: whether it has a bridge, and can run episodes that need a bridge.
    """

    protocol: int
    worker: Name
    credit: int
    host: Name = ""
    pid: Annotated[int, msgspec.Meta(ge=0, le=LARGEST_PID)] = 0
    life: Annotated[str, msgspec.Meta(max_length=LONGEST_LIFE)] = ""
    asked: int = 0
    holdings: Annotated[tuple[Holding, ...], msgspec.Meta(max_length=MAX_HOLDINGS)] = msgspec.field(
        default=(), name="claims"
    )
    versions: Versions = {}
    bridge: bool = False


class Welcome(Message, frozen=True):
    """Hub to worker: you have joined; send a heartbeat every `heartbeat_s`."""

    heartbeat_s: Annotated[float, msgspec.Meta(ge=0.05, le=3600.0)]


class Refusal(Message, frozen=True):
    """Hub to worker: you have not joined, for this reason."""

    reason: str


class Heartbeat(Message, frozen=True):
    """Worker to hub: sign of life.

    Attributes:
        campaign: campaign of the episode that it runs, if any.
        running: index of the episode that it runs, if any.
        held: campaign and index of all unfinished episodes that it holds, the running one included.
        slots: number of episodes of the running campaign that it can run in parallel.
        declined: campaigns whose episodes it cannot run, each with the reason, until they are
            dropped. The key is left out if there are none, as in releases without this field.
    """

    campaign: int | None = None
    running: int | None = None
    held: Annotated[tuple[tuple[int, int], ...], msgspec.Meta(max_length=MAX_HOLDINGS)] = ()
    slots: Annotated[int, msgspec.Meta(ge=1, le=MAX_HOLDINGS)] = 1
    declined: (
        Annotated[tuple[tuple[int, _Reason], ...], msgspec.Meta(max_length=MAX_HOLDINGS)]
        | msgspec.UnsetType
    ) = msgspec.UNSET


class BridgeReport(Message, frozen=True):
    """Worker to hub: what its bridge offers; sent after each welcome and when that changes.

    It is repeated every few heartbeats, as a message may be lost.

    Attributes:
        offer: None as long as the worker does not know it.
    """

    offer: BridgeOffer | None


class Setup(Message, frozen=True):
    """Hub to worker: what the episodes of a campaign share; sent before its first lease."""

    campaign: int
    setup: EpisodeSetup


class PolicyUpdate(Message, frozen=True):
    """Hub to worker: a policy version of a campaign; sent before the first lease that needs it."""

    campaign: int
    policy: Policy


class Lease(Message, frozen=True):
    """Hub to worker: episodes of a campaign that the worker is to run."""

    campaign: int
    tasks: tuple[EpisodeTask, ...]


class Results(Message, frozen=True):
    """Worker to hub: results of episodes. The worker keeps them until they are acknowledged."""

    campaign: int
    results: tuple[EpisodeResult, ...]


class Ack(Message, frozen=True):
    """Hub to worker: these results are committed or not needed; forget them.

    Without indices it answers a heartbeat, so that a worker notices a dead connection.
    """

    campaign: int
    indices: tuple[int, ...]


class Drop(Message, frozen=True):
    """Hub to worker: forget the episodes of this campaign that have not begun."""

    campaign: int


class Goodbye(Message, frozen=True):
    """Either side: end of the session; the worker's unfinished episodes go back to the hub."""

    reason: str = ""


class Piece(Message, frozen=True):
    """Either side: a part of a message that is too long for one frame; see `split`.

    Attributes:
        number: number of the message; its sender counts them.
        offset: offset of the part in the message. [bytes]
        total: length of the message. [bytes]
    """

    number: Annotated[int, msgspec.Meta(ge=1)]
    offset: Annotated[int, msgspec.Meta(ge=0)]
    total: Annotated[int, msgspec.Meta(ge=1)]
    data: bytes


WorkerMessage = Hello | Heartbeat | BridgeReport | Results | Goodbye | Piece
HubMessage = Welcome | Refusal | Setup | PolicyUpdate | Lease | Ack | Drop | Goodbye | Piece


class Start(Message, frozen=True):
    """Hub to learner process: run this method, from this checkpoint if there is one."""

    method: str
    settings: dict[str, Any]
    context: LearnerContext
    campaign_seed: int
    checkpoint: bytes | None
    rules: StopRules = StopRules()


class Observed(Message, frozen=True):
    """Hub to learner process: all results of the oldest open round, in index order."""

    results: tuple[EpisodeResult, ...]


class Stop(Message, frozen=True):
    """Hub to learner process: end."""


class Proposed(Message, frozen=True):
    """Learner process to hub: the open rounds, and a checkpoint that restores them.

    Without rounds the campaign is over, for the reason in `stopped_because`.
    """

    rounds: tuple[Round, ...]
    checkpoint: bytes
    stopped_because: str = msgspec.field(default="", name="because")
    estimate: Estimate | None = None
    trained_episodes: int | None = None


class Trouble(Message, frozen=True):
    """Learner process to hub: the learner cannot continue, for this reason."""

    problem: str


class Diverged(Message, frozen=True):
    """Learner process to hub: a number is NaN or infinite since the last checkpoint."""

    problem: str
    remedy: str = ""


LearnerCommand = Start | Observed | Stop
LearnerMessage = Proposed | Trouble | Diverged

_encoder = msgspec.msgpack.Encoder(enc_hook=encode_array)


def encode(message: Message) -> bytes:
    """Return the bytes of a message."""
    return _encoder.encode(message)


def decode_array(_kind: Any, value: Any) -> Floats:
    """Return the array of a packed form; a list, as in JSON, would be unbounded and untyped."""
    return unpack(msgspec.convert(value, PackedArray))


class MessageReader:
    """Decodes the messages of one direction."""

    def __init__(self, kinds: object) -> None:
        self._decoder = msgspec.msgpack.Decoder(kinds, dec_hook=decode_array)

    def __call__(self, data: bytes | memoryview) -> Message:
        """Decode the bytes of a message.

        Raises:
            ProtocolError: they are not a message of this direction, or too long.
        """
        if len(data) > MAX_MESSAGE_BYTES:
            raise ProtocolError(f"A message of {len(data)} bytes exceeds {MAX_MESSAGE_BYTES}.")
        try:
            message: Message = self._decoder.decode(data)
        # The bytes come from strangers: whatever they hold must end here, and not the hub.
        except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
            raise ProtocolError(f"Not a message of this protocol: {error}.") from error
        return message


class ForeignHello(msgspec.Struct, frozen=True, tag="Hello"):
    """The fields that a hello has in every version of the protocol."""

    protocol: int
    versions: Versions = {}


_foreign_decoder = msgspec.msgpack.Decoder(ForeignHello)


def read_foreign_hello(data: bytes) -> ForeignHello | None:
    """Return the hello of a worker of another release; None if the bytes are not a hello."""
    try:
        return _foreign_decoder.decode(data)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError):
        return None


read_worker_message = MessageReader(WorkerMessage)
read_hub_message = MessageReader(HubMessage)
read_learner_command = MessageReader(LearnerCommand)
read_learner_message = MessageReader(LearnerMessage)


# ZeroMQ delivers whole frames only: at 8 kbit/s, a policy of 100 kB would look like silence for
# 100 s. In pieces, each frame that arrives is a sign of life, and the largest frame to accept from
# a stranger is the longest hello.
PIECE_BYTES = 4096
"""Length of a piece: 4 s at 8 kbit/s, less than the silence after which either side gives up."""

MAX_FRAME_BYTES = 2**20
"""Longest frame between hub and workers: a `Hello` with all holdings and versions takes 750 kB and
is not split."""

MAX_BYTES_TO_HUB = 64 * 2**20
"""Longest message of a worker: a result with a scene of 40,000 steps and 100 vehicles."""

MAX_UNFINISHED_BYTES = 4 * MAX_BYTES_TO_HUB
"""Bytes of all incomplete messages that a hub holds at a time."""

_numbers = count(1)


def split(message: Message, max_bytes: int = MAX_MESSAGE_BYTES) -> Iterator[bytes]:
    """Yield the frames of a message, in the order of sending.

    Args:
        message: message to be sent.
        max_bytes: longest message that the receiver joins.

    Raises:
        ProtocolError: the message is longer.
    """
    data = encode(message)
    # A hello is whole, as a hub joins no pieces for a stranger.
    if len(data) <= PIECE_BYTES or isinstance(message, Hello):
        yield data
        return
    if len(data) > max_bytes:
        raise ProtocolError(f"A message of {len(data)} bytes exceeds {max_bytes}.")
    number = next(_numbers)
    for offset in range(0, len(data), PIECE_BYTES):
        part = data[offset : offset + PIECE_BYTES]
        yield encode(Piece(number, offset, len(data), part))


class Assembler:
    """Joiner of the pieces of one connection, one message at a time.

    If a piece is lost, the whole message is dropped. Its sender repeats it, like any other message,
    when it learns that the message did not arrive.

    Args:
        max_bytes: longest message that is joined.
    """

    def __init__(self, max_bytes: int = MAX_MESSAGE_BYTES) -> None:
        self._max_bytes = max_bytes
        self._number = 0
        self._data = bytearray()

    @property
    def held_bytes(self) -> int:
        """Bytes of the message that is not complete."""
        return len(self._data)

    def add(self, piece: Piece) -> bytes | None:
        """Take a piece; return the message if it is complete now.

        Raises:
            ProtocolError: the piece does not fit the size that it names.
        """
        fits = 0 < len(piece.data) <= piece.total - piece.offset
        if not fits or piece.total > self._max_bytes:
            self.clear()
            raise ProtocolError("A piece of a message does not fit the size that it names.")
        # A sender that begins anew has given up the message before.
        if piece.offset == 0:
            self._number, self._data = piece.number, bytearray()
        elif (piece.number, piece.offset) != (self._number, len(self._data)):
            self.clear()
            return None
        self._data += piece.data
        if len(self._data) < piece.total:
            return None
        whole = bytes(self._data)
        self.clear()
        return whole

    def clear(self) -> None:
        """Drop the message that is not complete."""
        self._number, self._data = 0, bytearray()
