"""Messages between a worker and a bridge. docs/bridge.md describes the protocol.

Unknown keys are ignored, so that either side may know more than the other. A message that cannot be
decoded is a SimulatorError: no message can run code, and no number in it is NaN or infinite.
"""

from collections.abc import Callable
from typing import Annotated, Any, Literal

import msgspec
from msgspec import Meta

from eigenfail.bridges import Plain, Steps, StepTime
from eigenfail.errors import (
    EpisodeError,
    InputError,
    InvalidValue,
    PlannerError,
    SimulatorError,
    SolverError,
)

PROTOCOL = 1
MAX_MESSAGE_BYTES = 16 * 1024 * 1024
MAX_SLOTS = 256
MAX_VEHICLES = 256
MAX_TEXT_CHARACTERS = 500

Number = Annotated[float, Meta(ge=-1e9, le=1e9)]
Size = Annotated[float, Meta(gt=0.0, le=1e9)]
Count = Annotated[int, Meta(ge=0)]
Name = Annotated[str, Meta(min_length=1, max_length=200)]
Pair = tuple[Number, Number]
Vehicle = tuple[Number, Number, Number, Number, Size, Size]
Defaults = dict[Name, Plain]
Fault = Literal["simulator", "planner", "solver", "input"]


class BridgeMessage(msgspec.Struct, frozen=True, tag_field="type"):
    """Base class of all messages; its tag is the value of `type`."""


class BridgeHello(BridgeMessage, frozen=True, tag="hello"):
    """Request to open a session (worker to bridge)."""

    protocol: int
    session: str


class SlotStart(msgspec.Struct, frozen=True):
    """Episode that a reset begins in one slot."""

    slot: int
    seed: int
    scenario: str
    parameters: dict[str, Plain]
    planner: str
    settings: dict[str, Plain]
    steps: int


class ResetRequest(BridgeMessage, frozen=True, tag="reset"):
    """Request to begin episodes (worker to bridge)."""

    session: str
    id: int
    slots: tuple[SlotStart, ...]


class SlotStep(msgspec.Struct, frozen=True):
    """Disturbance of one slot in a step. [m]"""

    slot: int
    disturbance: tuple[float, float]


class StepRequest(BridgeMessage, frozen=True, tag="step"):
    """Request to advance episodes by one step (worker to bridge)."""

    session: str
    id: int
    slots: tuple[SlotStep, ...]


class CloseRequest(BridgeMessage, frozen=True, tag="close"):
    """Request to end a session (worker to bridge)."""

    session: str
    id: int


class BridgeScenario(msgspec.Struct, frozen=True):
    """Scenario that the bridge offers, with the defaults of its parameters by name."""

    name: Name
    dt_s: StepTime
    steps: Steps
    parameters: Defaults | None = None


class BridgePlanner(msgspec.Struct, frozen=True):
    """Planner that the bridge offers, with the defaults of its settings by name."""

    name: Name
    settings: Defaults | None = None


class BridgeWelcome(BridgeMessage, frozen=True, tag="welcome"):
    """Acceptance of a session: what the bridge offers, and its number of slots."""

    protocol: int
    name: Name
    version: Name
    slots: Annotated[int, Meta(ge=1, le=MAX_SLOTS)]
    scenarios: Annotated[tuple[BridgeScenario, ...], Meta(min_length=1, max_length=1000)]
    planners: Annotated[tuple[BridgePlanner, ...], Meta(min_length=1, max_length=1000)]


class BridgeRefusal(BridgeMessage, frozen=True, tag="refusal"):
    """Refusal of a session, with the reason; `full` means that the worker may ask again."""

    reason: str
    full: bool | None = None


class SlotObservation(msgspec.Struct, frozen=True):
    """True state of the episode in one slot, or the fault that prevented it."""

    step: Count | None = None
    ego: Vehicle | None = None
    others: Annotated[tuple[Vehicle, ...], Meta(max_length=MAX_VEHICLES)] = ()
    collided: bool | None = None
    ended: bool | None = None
    perceived: Pair | None = None
    control: Pair | None = None
    applied: Pair | None = None
    off_road: bool | None = None
    fault: Fault | None = None
    message: str = ""


class Observations(BridgeMessage, frozen=True, tag="observations"):
    """Answer to a reset or a step: one observation a slot, in the order of the request."""

    id: int
    slots: Annotated[tuple[SlotObservation, ...], Meta(max_length=MAX_SLOTS)]


class Closed(BridgeMessage, frozen=True, tag="closed"):
    """Answer to a close request: the session has ended."""

    id: int


class BridgeError(BridgeMessage, frozen=True, tag="error"):
    """Failure of a whole request; `lost` means that the session has ended, too."""

    id: int
    fault: Fault
    message: str = ""
    lost: bool | None = None


Request = BridgeHello | ResetRequest | StepRequest | CloseRequest
Answer = BridgeWelcome | BridgeRefusal | Observations | Closed | BridgeError

_encoder = msgspec.msgpack.Encoder()
_decoder: msgspec.msgpack.Decoder[Any] = msgspec.msgpack.Decoder(Answer)

_ERRORS: dict[Fault, Callable[[str], EpisodeError | InputError]] = {
    "simulator": SimulatorError,
    "planner": PlannerError,
    "solver": SolverError,
    "input": lambda message: InvalidValue("bridge", message),
}


def encode(message: BridgeMessage) -> bytes:
    """Return the bytes of a message."""
    return _encoder.encode(message)


def read_answer(data: bytes) -> Answer:
    """Return the answer of a bridge that some bytes hold.

    Raises:
        SimulatorError: the bytes do not follow the protocol.
    """
    try:
        answer: Answer = _decoder.decode(data)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        problem = f"The bridge's answer cannot be read: {sanitize(str(error))}"
        raise SimulatorError(problem, "docs/bridge.md has the protocol.") from None
    return answer


def match_answer(
    answer: Observations | Closed, request_id: int | None, slots: int
) -> tuple[SlotObservation, ...]:
    """Return the observations of an answer, one for each slot of the request.

    Args:
        answer: answer of the bridge.
        request_id: request id of the request that it must answer; None if no such request is
            pending.
        slots: number of slots in that request.

    Raises:
        SimulatorError: the answer belongs to another request, or has another number of slots.
    """
    if isinstance(answer, Closed) or answer.id != request_id:
        raise SimulatorError("The bridge answered another question.", "It repeats its `id`.")
    if len(answer.slots) != slots:
        problem = f"The bridge answered for {len(answer.slots)} of {slots} slots."
        raise SimulatorError(problem, "It answers for each slot of the request, in its order.")
    return answer.slots


def make_error(fault: Fault, message: str) -> EpisodeError | InputError:
    """Return the error that a fault of the bridge stands for."""
    return _ERRORS[fault](sanitize(message) or f"The bridge blames the {fault} without a word.")


def sanitize(text: str) -> str:
    """Return a text of the bridge in printable characters, cut to a length that logs can hold."""
    return "".join(letter if letter.isprintable() else " " for letter in text[:MAX_TEXT_CHARACTERS])
