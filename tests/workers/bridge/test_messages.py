"""The protocol, byte for byte: every kind of message is a file in golden/."""

import json
import re
from pathlib import Path
from typing import Any

import pytest
from msgspec import convert
from msgspec.msgpack import decode
from msgspec.msgpack import encode as pack

from eigenfail.bridges import check_channels
from eigenfail.errors import PlannerError, SimulatorError
from eigenfail.values.channels import Channel
from eigenfail.values.disturbance import POSITION
from eigenfail.values.scene import Control, Observation, VehicleState
from eigenfail_workers import bridge
from eigenfail_workers.bridge import messages as said
from eigenfail_workers.bridge.episode import ObservationReader, record_step
from eigenfail_workers.bridge.messages import encode, read_answer

GOLDEN = Path(bridge.__file__).parent / "golden"
SESSION = "0123456789abcdef0123456789abcdef"
OF_TRUCK = {"distance_m": 55.0, "wet": True, "kind": "truck", "lanes": 2}
CHANNELS = (said.InjectedChannel("lateral"), said.InjectedChannel("ghost", 30.0))
STARTS = (
    said.SlotStart(0, 7, "cut_in", OF_TRUCK, "rulebook", {"beside_m": 6.0}, 100, CHANNELS, True),
    said.SlotStart(1, 2**63 - 1, "cut_in", {}, "idm", {}, 100, CHANNELS),
)
PUSHES = (
    said.SlotStep(0, {"lateral": -0.25, "ghost": 1.0}),
    said.SlotStep(1, {"lateral": 0.125, "ghost": 0.0}),
)
REQUESTS = {
    "hello": said.BridgeHello(2, SESSION),
    "hello_of_another_protocol": said.BridgeHello(1, SESSION),
    "reset": said.ResetRequest(SESSION, 1, STARTS),
    "step": said.StepRequest(SESSION, 2, PUSHES),
    "step_of_another_session": said.StepRequest("f" * 32, 3, PUSHES),
    "close": said.CloseRequest(SESSION, 4),
}
ego, other, moved = (0.0, 0.0, 0.0, 24.0, 16.5, 2.5), (100.0, 4.0, 0.0, 12.5, 4.5, 1.8), 2.375
ANSWERS = {
    "welcome": said.BridgeWelcome(
        2,
        "stub",
        "1.0",
        2,
        (said.BridgeScenario("cut_in", 0.1, 100, OF_TRUCK),),
        (said.BridgePlanner("rulebook", {"beside_m": 6.0}), said.BridgePlanner("idm", {})),
        channels=("lateral", "ghost"),
        signals=(said.BridgeSignal("planned_gap_m", "m", "gap that the planner keeps"),),
        seed_text=False,
    ),
    "refusal": said.BridgeRefusal("I speak protocol 2."),
    "observations_at_start": said.Observations(
        1,
        (
            said.SlotObservation(
                0,
                ego,
                (other,),
                False,
                False,
                off_road=False,
                ids=(1,),
                signals={"planned_gap_m": 20.0},
            ),
        )
        * 2,
    ),
    "observations_with_road": said.Observations(
        1,
        (
            said.SlotObservation(
                0,
                ego,
                (other,),
                False,
                False,
                off_road=False,
                kinds=("van",),
                road=(((0.0, -2.0), (200.0, -2.0)), ((0.0, 6.0), (100.0, 6.0), (200.0, 8.0))),
            ),
        ),
    ),
    "observations_after_step": said.Observations(
        2,
        (
            said.SlotObservation(
                step=1,
                ego=(moved, *ego[1:]),
                others=(other, other),
                collided=True,
                ended=True,
                perceived=(100.0, 3.75),
                control=(-7.5, 0.01),
                applied=(-7.0, 0.01),
                off_road=True,
                ids=(2, 1),
                signals={"planned_gap_m": 19.5},
                account={"heeds": "lead", "gap_m": 81.0},
                path=((moved, 0.0), (26.0, 0.0)),
            ),
            said.SlotObservation(fault="planner", message="It looked away."),
        ),
    ),
    "error": said.BridgeError(3, "simulator", "I do not know this session.", lost=True),
    "closed": said.Closed(4),
}
DIALOGUE = (
    ("hello_of_another_protocol", "refusal"),
    ("hello", "welcome"),
    ("reset", "observations_at_start"),
    ("step", "observations_after_step"),
    ("step_of_another_session", "error"),
    ("close", "closed"),
)


class Stub:
    """The simulations of the golden answers: the one of slot 1 fails in its first step."""

    def __init__(self, asked: dict[str, Any]) -> None:
        self.asked = asked

    @property
    def planner(self) -> "Stub":
        return self

    def explain(self) -> dict[str, object]:
        return {"heeds": "lead", "gap_m": 81.0}

    def path(self) -> list[tuple[float, float]]:
        return [(moved, 0.0), (26.0, 0.0)]

    def reset(self, seed: int) -> Observation:
        others = (VehicleState(*other),)
        signals = {"planned_gap_m": 20.0}
        return Observation(0, VehicleState(*ego), others, ids=(1,), signals=signals)

    def step(self, disturbance: tuple[float, ...]) -> Observation:
        if self.asked["planner"] == "idm":
            raise PlannerError("It looked away.")
        lateral_m, ghost = disturbance
        assert ghost == 1.0
        return Observation(
            step=1,
            ego=VehicleState(moved, *ego[1:]),
            others=(VehicleState(*other),) * 2,
            collided=True,
            ended=True,
            perceived=(100.0, 4.0 + lateral_m),
            control=Control(-7.5, 0.01),
            applied=Control(-7.0, 0.01),
            off_road=True,
            ids=(2, 1),
            signals={"planned_gap_m": 19.5},
        )


def golden(name: str) -> bytes:
    return (GOLDEN / f"{name}.msgpack").read_bytes()


def test_every_file_is_a_message_and_every_message_a_file() -> None:
    assert {file.stem for file in GOLDEN.iterdir()} == {*REQUESTS, *ANSWERS}


@pytest.mark.parametrize("name", REQUESTS)
def test_workers_ask_by_the_byte(name: str) -> None:
    assert encode(REQUESTS[name]) == golden(name)


@pytest.mark.parametrize("name", ANSWERS)
def test_workers_understand_every_answer(name: str) -> None:
    assert read_answer(golden(name)) == ANSWERS[name]


def test_the_reference_bridge_answers_by_the_byte(minimal) -> None:
    served = minimal.Bridge(decode(golden("welcome")), Stub)
    for request, answer in DIALOGUE:
        assert decode(pack(served.answer(decode(golden(request))))) == decode(golden(answer))


SPOILT = {
    "NaN": {"ego": [float("nan")] * 6},
    "no number": {"signals": {"gap_m": float("inf")}},
    "long account": {"account": {"text": "x" * 4096}},
    "long text": {"account": "x" * 4100},
    "nested account": {"account": {"a": {"b": 1}}},
    "path of one number": {"path": [[1.0]]},
    "no text": {"message": 7},
    "too large": {"perceived": [1e10, 0.0]},
    "five numbers": {"ego": [0.0] * 5},
    "no length": {"ego": [0.0] * 6},
    "a crowd": {"others": [[1.0] * 6] * 257},
    "nobody's fault": {"fault": "weather"},
}


@pytest.mark.parametrize("name", SPOILT)
def test_a_spoilt_observation_is_the_fault_of_its_slot_alone(name: str) -> None:
    answer = decode(golden("observations_at_start"))
    answer["slots"][0] = answer["slots"][0] | SPOILT[name]
    first, second = read_answer(pack(answer)).slots
    assert first.fault == "simulator"
    assert ("The account has" if name.startswith("long") else "cannot be read") in first.message
    assert second == ANSWERS["observations_at_start"].slots[1]


def test_an_account_of_exactly_the_most_bytes_is_read() -> None:
    text = "x" * (4096 - 3)
    answer = decode(golden("observations_at_start"))
    answer["slots"][0]["account"] = text
    assert len(pack(text)) == 4096
    assert read_answer(pack(answer)).slots[0].account == text


def test_an_answer_may_leave_out_what_is_optional_and_hold_what_nobody_knows() -> None:
    seen = {"step": 1, "ego": [0, 0, 0, 24, 16, 2], "others": [[9, 0, 0, 12, 4, 2]], "new": [1]}
    data = pack({"later": 1, "slots": [seen], "id": 5, "type": "observations"})
    whole = said.SlotObservation(
        1, (0.0, 0.0, 0.0, 24.0, 16.0, 2.0), ((9.0, 0.0, 0.0, 12.0, 4.0, 2.0),)
    )
    assert read_answer(data) == said.Observations(5, (whole,))


def read_page_sessions() -> list[list[tuple[str, dict[str, Any]]]]:
    """What each side says in the sessions on docs/bridge.md."""
    page = (Path(__file__).parents[3] / "docs" / "bridge.md").read_text()
    blocks = [block.split("```")[0] for block in page.split("```json\n")[1:]]
    return [
        [(line[0], json.loads(line[1:])) for line in re.split(r"\n(?=[→←])", block)]
        for block in blocks
    ]


def test_the_sessions_on_the_page_are_sessions() -> None:
    kinds = {
        "hello": said.BridgeHello,
        "reset": said.ResetRequest,
        "step": said.StepRequest,
        "close": said.CloseRequest,
    }
    sessions = read_page_sessions()
    assert len(sessions) == 2
    for session in sessions:
        sides, words = zip(*session, strict=True)
        assert "".join(sides) == "→←" * (len(words) // 2)
        for request in words[::2]:
            assert encode(convert(request, kinds[request["type"]])) == pack(request)
        answers = [read_answer(pack(answer)) for answer in words[1::2]]
        assert [answer.id for answer in answers[1:]] == [request["id"] for request in words[2::2]]


def read_page_episode(number: int, channels: tuple[Channel, ...], disturbance: tuple[float, ...]):
    """Return the welcome of a session on the page, and what is read of the start and a step."""
    words = [word for _, word in read_page_sessions()[number]]
    named = [channel.name for channel in channels]
    assert [each["name"] for each in words[2]["slots"][0]["channels"]] == named
    assert words[4]["slots"][0]["disturbances"] == dict(zip(named, disturbance, strict=True))
    welcome = read_answer(pack(words[1]))
    check_channels(welcome.offer, named)
    (began,), (went,) = (read_answer(pack(words[place])).slots for place in (3, 5))
    reader = ObservationReader(channels, 0.1)
    start = reader.read(began, ())
    return welcome, start, went, reader.read(went, disturbance)


def test_the_first_session_on_the_page_perceives_what_was_sent() -> None:
    _, start, went, _ = read_page_episode(0, POSITION, (0.5, -0.25))
    (seen,) = start.others
    assert went.perceived == (seen.x_m + 0.5, seen.y_m - 0.25)


def test_the_second_session_on_the_page_has_all_that_is_optional() -> None:
    channels = (Channel("missed"), Channel("vehicle_1.speed"))
    welcome, _, went, now = read_page_episode(1, channels, (1.0, -0.5))
    assert welcome.offer.signals == ("planned_gap_m",)
    assert now.ids == (1, 2)
    assert record_step(went, now, 0.1).account == {"heeds": "nobody", "gap_m": 29.5}


WRONG = {
    "no map": [1, 2],
    "no type": {"id": 1},
    "another type": {"type": "hello", "protocol": 2, "session": SESSION},
    "too many slots": {"type": "observations", "id": 1, "slots": [{}] * 257},
    "no slots": {**decode(golden("welcome")), "slots": 0},
    "endless steps": {"type": "welcome", "scenarios": [{"name": "a", "dt_s": 0.1, "steps": 1e9}]},
}


@pytest.mark.parametrize("name", WRONG)
def test_what_is_outside_the_protocol_is_the_simulators_fault(name: str) -> None:
    with pytest.raises(SimulatorError, match="cannot be read"):
        read_answer(pack(WRONG[name]))


@pytest.mark.parametrize("data", [b"", b"\xc1", b"\x01", b"\x80"])
def test_what_makes_no_sense_does_not_end_the_reference_bridge(minimal, data) -> None:
    served = minimal.Bridge(minimal.welcome(), minimal.built_in)
    told = minimal.answered(served, data)
    assert (told["type"], told["id"], told["fault"]) == ("error", 0, "simulator")
    assert told["message"]


def test_a_session_in_use_does_not_go_unless_its_worker_is_silent(minimal, monkeypatch) -> None:
    served = minimal.Bridge(decode(golden("welcome")), Stub)
    reset = decode(golden("reset"))
    for number in range(minimal.MOST_SESSIONS):
        served.answer({"type": "hello", "protocol": 2, "session": str(number)})
        slots = [{**each} for each in reset["slots"]]
        if number != 1:
            served.answer({**reset, "session": str(number), "slots": slots})
    hello = {"type": "hello", "protocol": 2}
    assert served.answer({**hello, "session": "a"})["type"] == "welcome"
    assert "0" in served.sessions
    assert "1" not in served.sessions
    served.answer({**reset, "session": "a"})
    assert served.answer({**hello, "session": "b"})["full"]
    monkeypatch.setattr(minimal, "SILENT_S", -1.0)
    assert served.answer({**hello, "session": "b"})["type"] == "welcome"
    assert "0" not in served.sessions


def test_the_session_goes_that_has_not_asked_for_longest(minimal) -> None:
    served = minimal.Bridge(minimal.welcome(), minimal.built_in)
    for number in range(minimal.MOST_SESSIONS):
        served.answer({"type": "hello", "protocol": 2, "session": str(number)})
    served.answer({"type": "step", "session": "0", "id": 1, "slots": []})
    served.answer({"type": "hello", "protocol": 2, "session": "new"})
    assert {*map(str, range(minimal.MOST_SESSIONS)), "new"} - {*served.sessions} == {"1"}
