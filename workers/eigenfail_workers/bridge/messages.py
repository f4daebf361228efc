"""What a worker and a bridge say to each other; the protocol is on docs/bridge.md.

Unknown keys are passed over, so that either side may know more than the other. A message that does
not decode is a SimulatorError: nothing in it can run code, and no number in it is NaN or infinite.
"""

from typing import Annotated, Any, Literal

import msgspec
from msgspec import Meta

from eigenfail.bridges import Plain, Steps, StepTime
from eigenfail.errors import SimulatorError

PROTOCOL = 1
MAX_MESSAGE_BYTES = 16 * 1024 * 1024
MOST_SLOTS = 256
MOST_VEHICLES = 256
LONGEST_WORDS = 500

Number = Annotated[float, Meta(ge=-1e9, le=1e9)]
Size = Annotated[float, Meta(gt=0.0, le=1e9)]
Count = Annotated[int, Meta(ge=0)]
Name = Annotated[str, Meta(min_length=1, max_length=200)]
Pair = tuple[Number, Number]
Vehicle = tuple[Number, Number, Number, Number, Size, Size]
Named = dict[Name, Plain]
Fault = Literal["simulator", "planner", "solver", "input"]


class Message(msgspec.Struct, frozen=True, tag_field="type", tag=str.lower):
    """Anything that is said."""


class Hello(Message, frozen=True):
    """Worker: this is who I am; may I come in?"""

    protocol: int
    session: str


class Start(msgspec.Struct, frozen=True):
    """Of a reset: what is to begin in a slot."""

    slot: int
    seed: int
    scenario: str
    parameters: dict[str, Plain]
    planner: str
    settings: dict[str, Plain]
    steps: int


class Reset(Message, frozen=True):
    """Worker: begin these episodes."""

    session: str
    id: int
    slots: tuple[Start, ...]


class Push(msgspec.Struct, frozen=True):
    """Of a step: the disturbance in a slot. [m]"""

    slot: int
    disturbance: tuple[float, float]


class Step(Message, frozen=True):
    """Worker: move these episodes by one step."""

    session: str
    id: int
    slots: tuple[Push, ...]


class Close(Message, frozen=True):
    """Worker: I have no more to ask."""

    session: str
    id: int


class Scenario(msgspec.Struct, frozen=True):
    """A scenario that the bridge knows; `parameters` are its defaults by name."""

    name: Name
    dt_s: StepTime
    steps: Steps
    parameters: Named | None = None


class Planner(msgspec.Struct, frozen=True):
    """A planner that the bridge knows; `settings` are its defaults by name."""

    name: Name
    settings: Named | None = None


class Welcome(Message, frozen=True):
    """Bridge: this is what I am, and how many episodes I hold side by side."""

    protocol: int
    name: Name
    version: Name
    slots: Annotated[int, Meta(ge=1, le=MOST_SLOTS)]
    scenarios: Annotated[tuple[Scenario, ...], Meta(min_length=1, max_length=1000)]
    planners: Annotated[tuple[Planner, ...], Meta(min_length=1, max_length=1000)]


class Refusal(Message, frozen=True):
    """Bridge: you are not served, and why; `full` means: ask again."""

    reason: str
    full: bool | None = None


class Seen(msgspec.Struct, frozen=True):
    """Of observations: what is true in a slot, or whose fault it is that nothing is."""

    step: Count | None = None
    ego: Vehicle | None = None
    others: Annotated[tuple[Vehicle, ...], Meta(max_length=MOST_VEHICLES)] = ()
    collided: bool | None = None
    ended: bool | None = None
    perceived: Pair | None = None
    control: Pair | None = None
    applied: Pair | None = None
    off_road: bool | None = None
    fault: Fault | None = None
    message: str = ""


class Observations(Message, frozen=True):
    """Bridge: what came of a reset or a step, for each of its slots, in its order."""

    id: int
    slots: Annotated[tuple[Seen, ...], Meta(max_length=MOST_SLOTS)]


class Closed(Message, frozen=True):
    """Bridge: the session is over."""

    id: int


class Error(Message, frozen=True):
    """Bridge: the whole request failed; `lost` means: the session is over, begin another one."""

    id: int
    fault: Fault
    message: str = ""
    lost: bool | None = None


Request = Hello | Reset | Step | Close
Answer = Welcome | Refusal | Observations | Closed | Error

_encoder = msgspec.msgpack.Encoder()
_decoder: msgspec.msgpack.Decoder[Any] = msgspec.msgpack.Decoder(Answer)


def encode(message: Message) -> bytes:
    """The bytes of a message."""
    return _encoder.encode(message)


def read_answer(data: bytes) -> Answer:
    """What a bridge said.

    Raises:
        SimulatorError: it does not follow the protocol.
    """
    try:
        answer: Answer = _decoder.decode(data)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        problem = f"The bridge's answer cannot be read: {in_words(str(error))}"
        raise SimulatorError(problem, "docs/bridge.md has the protocol.") from None
    return answer


def in_words(text: str) -> str:
    """What a stranger wrote, as a log and a database take it."""
    return "".join(letter if letter.isprintable() else " " for letter in text[:LONGEST_WORDS])
