"""Messages between a worker and a bridge. docs/bridge.md describes the protocol.

Unknown keys are ignored, so that either side may be newer. A message that cannot be decoded is a
SimulatorError: no message can run code, and no number in it is NaN or infinite. An observation that
cannot be decoded is the fault of its slot alone.
"""

from collections.abc import Callable, Iterator
from typing import Annotated, Literal

import msgspec
from msgspec import Meta

from eigenfail import bridges, errors
from eigenfail.values.disturbance import AXES

PROTOCOL = 2
"""The protocol that worker and bridge must both speak; any other one is refused."""

MAX_MESSAGE_BYTES = 16 * 1024 * 1024
MAX_SLOTS = 256
MAX_VEHICLES = 256
MAX_TEXT_CHARACTERS = 500
MAX_CHANNELS = 1_000
MAX_SIGNALS = 100
MAX_ACCOUNT_BYTES = 4096
MAX_PATH_POINTS = 1_000
MAX_BORDERS = 64
MAX_ROAD_POINTS = 2_000

Number = Annotated[float, Meta(ge=-1e9, le=1e9)]
Size = Annotated[float, Meta(gt=0.0, le=1e9)]
Count = Annotated[int, Meta(ge=0)]
Pair = tuple[Number, Number]
Vehicle = tuple[Number, Number, Number, Number, Size, Size]
Defaults = dict[bridges.Name, bridges.Plain]
Border = Annotated[tuple[Pair, ...], Meta(min_length=2, max_length=MAX_ROAD_POINTS)]
Fault = Literal["simulator", "planner", "solver", "input"]


class BridgeMessage(msgspec.Struct, frozen=True, tag_field="type"):
    """Base class of all messages; its tag is the value of `type`."""


class BridgeHello(BridgeMessage, frozen=True, tag="hello"):
    """Request to open a session (worker to bridge).

    Attributes:
        protocol: number of the protocol that the worker speaks.
        session: text that the worker made up.
    """

    protocol: int
    session: str


class InjectedChannel(msgspec.Struct, frozen=True, omit_defaults=True):
    """Channel that is disturbed in an episode.

    Attributes:
        name: its name.
        ahead_m: only for a ghost: distance ahead of the ego's centre at which it is first seen.
    """

    name: str
    ahead_m: float | None = None


class SlotStart(msgspec.Struct, frozen=True, omit_defaults=True):
    """Episode that a reset begins in one slot.

    Attributes:
        seed: seed of the episode; a text if the bridge's welcome sets `seed_text`.
        channels: channels for which each step holds a value.
        explain: whether the bridge is to say what its planner computes.
    """

    slot: int
    seed: int | str
    scenario: str
    parameters: dict[str, bridges.Plain]
    planner: str
    settings: dict[str, bridges.Plain]
    steps: int
    channels: tuple[InjectedChannel, ...]
    explain: bool = False


class ResetRequest(BridgeMessage, frozen=True, tag="reset"):
    """Request to begin episodes (worker to bridge)."""

    session: str
    id: int
    slots: tuple[SlotStart, ...]


class SlotStep(msgspec.Struct, frozen=True):
    """Disturbance of one slot in a step.

    Attributes:
        disturbances: value of each channel by name, in its unit; for an event, 1 while it lasts,
            and otherwise 0.
    """

    slot: int
    disturbances: dict[str, float]


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

    name: bridges.Name
    dt_s: bridges.StepTime
    steps: bridges.Steps
    parameters: Defaults | None = None


class BridgePlanner(msgspec.Struct, frozen=True):
    """Planner that the bridge offers, with the defaults of its settings by name."""

    name: bridges.Name
    settings: Defaults | None = None


class BridgeSignal(msgspec.Struct, frozen=True):
    """Named number that the bridge reports of each step."""

    name: Annotated[str, Meta(max_length=100, pattern="^[A-Za-z_][A-Za-z_0-9]*$")]
    unit: Annotated[str, Meta(max_length=20)] = ""
    words: Annotated[str, Meta(max_length=200)] = ""


class BridgeWelcome(BridgeMessage, frozen=True, tag="welcome"):
    """Acceptance of a session: what the bridge offers, and its number of slots.

    Attributes:
        channels: names of the channels that the bridge can disturb; default: both channels of the
            nearest vehicle's position. `every.` means each vehicle.
        signals: signals that each observation has a value of.
        seed_text: whether seeds are to be sent as text.
    """

    protocol: int
    name: bridges.Name
    version: bridges.Name
    slots: Annotated[int, Meta(ge=1, le=MAX_SLOTS)]
    scenarios: Annotated[tuple[BridgeScenario, ...], Meta(min_length=1, max_length=1000)]
    planners: Annotated[tuple[BridgePlanner, ...], Meta(min_length=1, max_length=1000)]
    channels: Annotated[tuple[bridges.Name, ...], Meta(max_length=MAX_CHANNELS)] | None = None
    signals: Annotated[tuple[BridgeSignal, ...], Meta(max_length=MAX_SIGNALS)] = ()
    seed_text: bool | None = None

    @property
    def offer(self) -> bridges.BridgeOffer:
        """The bridge's offer to campaigns: names, without the defaults."""
        scenarios = [
            bridges.OfferedScenario(each.name, each.dt_s, each.steps, tuple(each.parameters or ()))
            for each in self.scenarios
        ]
        planners = [
            bridges.OfferedPlanner(each.name, tuple(each.settings or ())) for each in self.planners
        ]
        channels = AXES if self.channels is None else self.channels
        return bridges.BridgeOffer(
            self.name,
            self.version,
            tuple(scenarios),
            tuple(planners),
            tuple(sorted(set(channels))),
            tuple(sorted({signal.name for signal in self.signals})),
        )


class BridgeRefusal(BridgeMessage, frozen=True, tag="refusal"):
    """Refusal of a session, with the reason; `full` means that the worker may ask again."""

    reason: str
    full: bool | None = None


PlannerAccount = dict[bridges.Name, bool | Number | str]


class SlotObservation(msgspec.Struct, frozen=True):
    """True state of the episode in one slot, or the fault that prevented it.

    Attributes:
        ids: id of each other vehicle, which identifies vehicles that come and go.
        signals: values of the signals of the welcome, by name.
        account: what the planner believed in the step just taken.
        path: points of the planned path, the present position first. [m]
        kinds: kind of each other vehicle, in the order of `others`.
        road: borders of the lanes, each a list of points; only at the start. [m]
        peak_braking_mps2: largest deceleration of the ego's brakes; only at the start.
    """

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
    ids: Annotated[tuple[int | bridges.Name, ...], Meta(max_length=MAX_VEHICLES)] | None = None
    signals: Annotated[dict[bridges.Name, Number], Meta(max_length=MAX_SIGNALS)] | None = None
    account: PlannerAccount | str | None = None
    path: Annotated[tuple[Pair, ...], Meta(max_length=MAX_PATH_POINTS)] | None = None
    kinds: Annotated[tuple[bridges.Name, ...], Meta(max_length=MAX_VEHICLES)] | None = None
    road: Annotated[tuple[Border, ...], Meta(max_length=MAX_BORDERS)] | None = None
    peak_braking_mps2: Size | None = None


class Observations(BridgeMessage, frozen=True, tag="observations"):
    """Answer to a reset or a step: one observation a slot, in the order of the request."""

    id: int
    slots: Annotated[tuple[SlotObservation, ...], Meta(max_length=MAX_SLOTS)]


class RawObservations(BridgeMessage, frozen=True, tag="observations"):
    """The same message with the bytes of each observation, so that each is read separately."""

    id: int
    slots: Annotated[tuple[msgspec.Raw, ...], Meta(max_length=MAX_SLOTS)]


class Closed(BridgeMessage, frozen=True, tag="closed"):
    """Answer to a close request: the session has ended."""

    id: int


class BridgeError(BridgeMessage, frozen=True, tag="error"):
    """Failure of a whole request; `lost` means that the session has ended, too."""

    id: int
    fault: Fault
    message: str = ""
    lost: bool | None = None


Answer = BridgeWelcome | BridgeRefusal | Observations | Closed | BridgeError


_encoder = msgspec.msgpack.Encoder()
_slot_decoder = msgspec.msgpack.Decoder(SlotObservation)
_answer_decoder = msgspec.msgpack.Decoder(
    BridgeWelcome | BridgeRefusal | RawObservations | Closed | BridgeError
)
_UNREADABLE = msgspec.DecodeError, UnicodeDecodeError, RecursionError

_ERRORS: dict[Fault, Callable[[str], errors.EpisodeError | errors.InputError]] = {
    "simulator": errors.SimulatorError,
    "planner": errors.PlannerError,
    "solver": errors.SolverError,
    "input": lambda message: errors.InvalidValue("bridge", message),
}


def encode(message: BridgeMessage) -> bytes:
    """Return the bytes of a message."""
    return _encoder.encode(message)


def read_answer(data: bytes) -> Answer:
    """Return the answer of a bridge, decoded from its bytes.

    Raises:
        SimulatorError: the bytes do not follow the protocol.
    """
    try:
        answer = _answer_decoder.decode(data)
    except _UNREADABLE as error:
        raise _make_unreadable(error) from None
    # Slot by slot: an observation that cannot be read is the fault of its own episode alone.
    if isinstance(answer, RawObservations):
        return Observations(answer.id, tuple(map(_read_slot, answer.slots)))
    found: Answer = answer
    return found


def _read_slot(data: msgspec.Raw) -> SlotObservation:
    """Return an observation; one that cannot be read is a fault of the simulator."""
    try:
        seen = _slot_decoder.decode(data)
    except _UNREADABLE as error:
        return SlotObservation(fault="simulator", message=_make_unreadable(error).problem)
    # The first excess is enough: the observation is refused as a whole.
    for excess in _list_excesses(seen):
        return SlotObservation(fault="simulator", message=excess)
    return seen


def _list_excesses(seen: SlotObservation) -> Iterator[str]:
    """Yield the parts of an observation that are too long, in sentences."""
    size = 0 if seen.account is None else len(_encoder.encode(seen.account))
    if size > MAX_ACCOUNT_BYTES:
        yield f"The account has {size} bytes; {MAX_ACCOUNT_BYTES} are the most."
    points = sum(map(len, seen.road or ()))
    if points > MAX_ROAD_POINTS:
        yield f"The road has {points} points; {MAX_ROAD_POINTS} are the most."


def _make_unreadable(error: Exception) -> errors.SimulatorError:
    problem = f"The bridge's answer cannot be read: {sanitize(str(error))}"
    return errors.SimulatorError(problem, "docs/bridge.md has the protocol.")


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
    # A late answer to an earlier request would put one step's state into another.
    if isinstance(answer, Closed) or answer.id != request_id:
        raise errors.SimulatorError("The bridge answered another question.", "It repeats its `id`.")
    if len(answer.slots) != slots:
        problem = f"The bridge answered for {len(answer.slots)} of {slots} slots."
        raise errors.SimulatorError(
            problem, "It answers for each slot of the request, in its order."
        )
    return answer.slots


def make_error(fault: Fault, message: str) -> errors.EpisodeError | errors.InputError:
    """Return the error for a fault that the bridge reports."""
    return _ERRORS[fault](sanitize(message) or f"The bridge blames the {fault} without a word.")


def sanitize(text: str) -> str:
    """Return a text of the bridge in printable characters, cut to a length that logs can hold."""
    return "".join(letter if letter.isprintable() else " " for letter in text[:MAX_TEXT_CHARACTERS])
