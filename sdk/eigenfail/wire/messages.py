"""What hub, workers and learners say to each other.

MessagePack through tagged structs; arrays as shape and little-endian float32 bytes. A message that
does not decode is a ProtocolError and nothing else: nothing in it can run code.
"""

from typing import Annotated, Any

import msgspec

from eigenfail.errors import ProtocolError
from eigenfail.values import (
    EpisodeResult,
    EpisodeSetup,
    EpisodeTask,
    Estimate,
    LearnerContext,
    Policy,
    Round,
    StopRules,
)
from eigenfail.values.arrays import Floats, PackedArray, encode_array, unpack
from eigenfail.values.worker import Name, Versions
from eigenfail.wire.claims import MAX_CLAIMS, Claim

PROTOCOL = 5
"""Counts up with every change that an older peer would not understand."""

MAX_MESSAGE_BYTES = 256 * 1024 * 1024
LONGEST_LIFE = 64
LARGEST_PID = 2**31 - 1


class Message(msgspec.Struct, frozen=True, eq=False, tag=True, forbid_unknown_fields=True):
    """Anything that is said."""


class Hello(Message, frozen=True):
    """Worker: I am here and can hold `credit` episodes at a time.

    Attributes:
        life: of its process, the same on whatever connection it comes; empty for nobody's.
        asked: which time it asks to be let in. It says hello until it is welcomed, and only the
            first of these tells the hub anything new.
        claims: what it holds from before: leased and not begun, running, or finished and not
            acknowledged.
        versions: of what it runs its episodes with.
        bridge: whether it has one, so that it can run what is to be run on a bridge.
    """

    protocol: int
    worker: Name
    credit: int
    host: Name = ""
    pid: Annotated[int, msgspec.Meta(ge=0, le=LARGEST_PID)] = 0
    life: Annotated[str, msgspec.Meta(max_length=LONGEST_LIFE)] = ""
    asked: int = 0
    claims: Annotated[tuple[Claim, ...], msgspec.Meta(max_length=MAX_CLAIMS)] = ()
    versions: Versions = {}
    bridge: bool = False


class Welcome(Message, frozen=True):
    """Hub: you are in; be heard every `heartbeat_s`."""

    heartbeat_s: Annotated[float, msgspec.Meta(ge=0.05, le=3600.0)]


class Refusal(Message, frozen=True):
    """Hub: you are not in, and why."""

    reason: str


class Heartbeat(Message, frozen=True):
    """Worker: I live. `running` is the episode being run, if any.

    `held` are campaign and index of all that it holds and has not finished, that one included.
    `slots` says how many episodes of the campaign that it runs may be run side by side.
    """

    campaign: int | None = None
    running: int | None = None
    held: Annotated[tuple[tuple[int, int], ...], msgspec.Meta(max_length=MAX_CLAIMS)] = ()
    slots: Annotated[int, msgspec.Meta(ge=1, le=MAX_CLAIMS)] = 1


class Setup(Message, frozen=True):
    """Hub: what the episodes of a campaign share; sent before its first lease."""

    campaign: int
    setup: EpisodeSetup


class PolicyUpdate(Message, frozen=True):
    """Hub: a policy version of a campaign; sent before the first lease that needs it."""

    campaign: int
    policy: Policy


class Lease(Message, frozen=True):
    """Hub: run these."""

    campaign: int
    tasks: tuple[EpisodeTask, ...]


class Results(Message, frozen=True):
    """Worker: they are done. Kept until acknowledged."""

    campaign: int
    results: tuple[EpisodeResult, ...]


class Ack(Message, frozen=True):
    """Hub: the results with these indices are committed (or not wanted); forget them.

    With none of them it answers a heartbeat, so that a worker knows a line that is dead.
    """

    campaign: int
    indices: tuple[int, ...]


class Drop(Message, frozen=True):
    """Hub: forget what this campaign has not begun."""

    campaign: int


class Goodbye(Message, frozen=True):
    """Either: I leave; what I hold and have not finished is yours again."""

    reason: str = ""


WorkerMessage = Hello | Heartbeat | Results | Goodbye
HubMessage = Welcome | Refusal | Setup | PolicyUpdate | Lease | Ack | Drop | Goodbye


class Start(Message, frozen=True):
    """Hub to a learner process: be this method, from this checkpoint if there is one."""

    method: str
    settings: dict[str, Any]
    context: LearnerContext
    campaign_seed: int
    checkpoint: bytes | None
    rules: StopRules = StopRules()


class Observed(Message, frozen=True):
    """Hub to a learner process: the whole oldest open round, in index order."""

    results: tuple[EpisodeResult, ...]


class Stop(Message, frozen=True):
    """Hub to a learner process: end."""


class Proposed(Message, frozen=True):
    """Learner process: the rounds that are open now, and a checkpoint that restores just that.

    An empty `rounds` means that the campaign is over; `because` says why.
    """

    rounds: tuple[Round, ...]
    checkpoint: bytes
    because: str = ""
    estimate: Estimate | None = None
    trained_episodes: int | None = None


class Trouble(Message, frozen=True):
    """Learner process: I cannot go on, and why."""

    problem: str


class Diverged(Message, frozen=True):
    """Learner process: a number in me is NaN or infinite; my last checkpoint is from before."""

    problem: str
    remedy: str = ""


LearnerCommand = Start | Observed | Stop
LearnerMessage = Proposed | Trouble | Diverged

_encoder = msgspec.msgpack.Encoder(enc_hook=encode_array)


def encode(message: Message) -> bytes:
    """The bytes of a message."""
    return _encoder.encode(message)


def decode_array(_kind: Any, value: Any) -> Floats:
    """The array of its packed form; a list, as in JSON, would be unbounded and untyped."""
    return unpack(msgspec.convert(value, PackedArray))


class Reader:
    """Reads the messages of one direction."""

    def __init__(self, kinds: object) -> None:
        self._decoder = msgspec.msgpack.Decoder(kinds, dec_hook=decode_array)

    def __call__(self, data: bytes | memoryview) -> Message:
        """The message.

        Raises:
            ProtocolError: the bytes are not one.
        """
        if len(data) > MAX_MESSAGE_BYTES:
            raise ProtocolError(f"A message of {len(data)} bytes exceeds {MAX_MESSAGE_BYTES}.")
        try:
            message: Message = self._decoder.decode(data)
        except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
            raise ProtocolError(f"Not a message of this protocol: {error}.") from error
        return message


class ForeignHello(msgspec.Struct, frozen=True, tag="Hello"):
    """What every hello says, whatever protocol its worker speaks."""

    protocol: int
    versions: Versions = {}


_foreign_decoder = msgspec.msgpack.Decoder(ForeignHello)


def read_foreign_hello(data: bytes) -> ForeignHello | None:
    """The hello of a worker of another release; None if the bytes are none."""
    try:
        return _foreign_decoder.decode(data)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError):
        return None


read_worker_message = Reader(WorkerMessage)
read_hub_message = Reader(HubMessage)
read_learner_command = Reader(LearnerCommand)
read_learner_message = Reader(LearnerMessage)
