"""The C++ headers, built with warnings as errors and with sanitizers, by the golden bytes."""

import signal
import subprocess
from pathlib import Path

import deadlines
import numpy as np
import pytest
import zmq
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from msgspec.msgpack import decode, encode

from eigenfail.cli.specs import read_spec
from eigenfail.values.episode import EpisodeTask, PriorSource, episode_seed
from eigenfail_workers import bridge

HERE = Path(__file__).parent
BRIDGES = HERE.parents[2] / "examples" / "bridge"
GOLDEN = {
    file.stem: file.read_bytes()
    for file in sorted((Path(bridge.__file__).parent / "golden").iterdir())
}
DIALOGUE = (
    ("hello_of_another_protocol", "refusal"),
    ("hello", "welcome"),
    ("reset", "observations_at_start"),
    ("step", "observations_after_step"),
    ("step_of_another_session", "error"),
    ("close", "closed"),
)
ABOVE = (0, 127, 128, 255, 256, 2**16, 2**32, 2**64 - 1)
BELOW = (-1, -32, -33, -128, -129, -(2**15) - 1, -(2**31), -(2**63))
SIZES = (0, 15, 16, 31, 32, 255, 256, 2**16)
CASES = {
    "numbers": [*ABOVE, *BELOW, 0.1, -1e300, float("inf"), True, False, None],
    "texts": ["a" * size for size in SIZES],
    "lists": [[0] * size for size in SIZES],
    "maps": [{str(key): key for key in range(size)} for size in SIZES],
}


@pytest.fixture(scope="module")
def stub(compiled) -> Path:
    return compiled(HERE / "stub.cpp")


@pytest.fixture
def patience() -> tuple[str, ...]:
    """What the stub is told of it."""
    return ()


@pytest.fixture
def ask(start, stub, patience):
    """Sends requests to the stub, which has to end well afterwards."""
    started = start(stub, *patience)
    with zmq.Context() as context, context.socket(zmq.REQ) as socket:
        socket.setsockopt(zmq.RCVTIMEO, 10_000)
        socket.setsockopt(zmq.LINGER, 0)
        socket.connect(started.address)

        def run(request: bytes) -> bytes:
            socket.send(request)
            return socket.recv()

        yield run
    started.program.send_signal(signal.SIGTERM)
    _, told = started.program.communicate(timeout=deadlines.PROCESS_S)
    assert (started.program.returncode, told) == (0, "")


def echoed(stub: Path, message: bytes) -> bytes:
    return subprocess.run([stub, "echo"], input=message, capture_output=True, check=True).stdout


@pytest.mark.parametrize("name", GOLDEN)
def test_golden_messages_are_read_and_written_by_the_byte(stub, name) -> None:
    assert echoed(stub, GOLDEN[name]) == GOLDEN[name]


@pytest.mark.parametrize("name", CASES)
def test_values_of_every_size_are_written_as_everybody_does(stub, name) -> None:
    message = encode(CASES[name])
    assert echoed(stub, message) == message


def test_messages_that_end_too_early_or_never_are_refused(stub) -> None:
    whole = GOLDEN["reset"]
    wrong = [whole[:length] for length in (0, 1, 5, 40, len(whole) - 1)]
    wrong += [
        whole + b"\0",
        b"\xdf\xff\xff\xff\xff",
        b"\x91" * 1000,
        b"\xc1",
        b"\xdb\xff\xff\xff\xff",
    ]
    for message in wrong:
        told = subprocess.run([stub, "echo"], input=message, capture_output=True, check=False)
        assert (told.returncode, told.stderr) == (1, b""), message


def told_of(answer: bytes) -> object:
    """What an answer says; nil is what is left out, and words to people are any words."""
    return without_nil(decode(answer))


def without_nil(value: object) -> object:
    if isinstance(value, list):
        return [without_nil(each) for each in value]
    if isinstance(value, dict):
        kept = {key: without_nil(each) for key, each in value.items() if each is not None}
        return kept | {key: "…" for key in ("reason", "message") if kept.get(key)}
    return value


def test_it_leads_the_golden_dialogue(ask) -> None:
    for request, answer in DIALOGUE:
        assert told_of(ask(GOLDEN[request])) == told_of(GOLDEN[answer]), request


def test_slots_that_are_over_and_names_that_nobody_knows_are_faults(ask) -> None:
    ask(GOLDEN["hello"])
    ask(GOLDEN["reset"])
    ask(GOLDEN["step"])
    over = decode(ask(GOLDEN["step"]))["slots"]
    assert [each["fault"] for each in over] == ["simulator"] * 2
    reset = decode(GOLDEN["reset"])
    for key, value in {
        "scenario": "x",
        "planner": "x",
        "steps": 101,
        "parameters": {"x": 1},
    }.items():
        reset["slots"] = [decode(GOLDEN["reset"])["slots"][0] | {key: value}]
        assert decode(ask(encode(reset)))["slots"][0]["fault"] == "input", key
    reset["slots"] = [decode(GOLDEN["reset"])["slots"][0] | {"slot": 2}]
    assert decode(ask(encode(reset)))["type"] == "error"


def test_channels_that_it_does_not_offer_are_faults_of_their_slots(ask) -> None:
    ask(GOLDEN["hello"])
    reset = decode(GOLDEN["reset"])
    reset["slots"][1]["channels"] = [{"name": "longitudinal"}]
    known, unknown = decode(ask(encode(reset)))["slots"]
    assert "fault" not in known
    assert (unknown["fault"], unknown["message"]) == ("input", "There is no channel of that name.")
    reset["slots"][1]["channels"] = [{"name": "vehicle_1.speed"}]
    assert decode(ask(encode(reset)))["slots"][1]["fault"] == "input"


def test_an_account_is_given_where_it_is_asked_for(ask) -> None:
    ask(GOLDEN["hello"])
    reset = decode(GOLDEN["reset"])
    for each in reset["slots"]:
        each.pop("explain", None)
    ask(encode(reset))
    first, _ = decode(ask(GOLDEN["step"]))["slots"]
    assert first["signals"] == {"planned_gap_m": 19.5}
    assert first.keys().isdisjoint({"account", "path"})


WRONG = {
    "distance_m": ("far", "'distance_m' has to be a number, and not a text."),
    "wet": (1, "'wet' has to be a truth value, and not a whole number."),
    "kind": (3.5, "'kind' has to be a text, and not a number."),
    "lanes": (1.5, "'lanes' has to be a whole number, and not a number."),
    "lamps": (1, "There is no parameter 'lamps'."),
}
RIGHT = {"distance_m": [1, -2, 3.5], "wet": [False], "kind": [""], "lanes": [3, 3.0, -1]}


def reset_with(parameters: dict[str, object]) -> bytes:
    reset = decode(GOLDEN["reset"])
    reset["slots"] = [reset["slots"][0] | {"parameters": parameters}]
    return encode(reset)


@pytest.mark.parametrize("name", WRONG)
def test_a_parameter_of_the_wrong_kind_is_refused_with_its_name(ask, name) -> None:
    value, said = WRONG[name]
    ask(GOLDEN["hello"])
    (fault,) = decode(ask(reset_with({name: value})))["slots"]
    assert (fault["fault"], fault["message"]) == ("input", said)


@pytest.mark.parametrize("name", RIGHT)
def test_any_number_will_do_for_a_number_and_a_whole_one_for_a_whole_one(ask, name) -> None:
    ask(GOLDEN["hello"])
    for value in RIGHT[name]:
        (seen,) = decode(ask(reset_with({name: value})))["slots"]
        assert "fault" not in seen, seen


def test_a_request_of_the_wrong_kinds_is_an_error_that_says_so(ask) -> None:
    ask(GOLDEN["hello"])
    step = decode(GOLDEN["step"])
    for wrong, said in (
        ({"slots": 7}, "There is a whole number where a list is due."),
        ({"slots": [{"slot": "a"}]}, "There is a text where a whole number from 0 is due."),
        ({"session": 7}, "There is a whole number where a text is due."),
    ):
        answer = decode(ask(encode(step | wrong)))
        assert (answer["type"], answer["message"]) == ("error", said)
        assert "lost" not in answer


SESSIONS = 64


def hello(ask, session: str) -> dict[str, object]:
    return decode(ask(encode(decode(GOLDEN["hello"]) | {"session": session})))


def begins(ask, session: str) -> str:
    """An episode that runs, as far as the bridge lets it begin."""
    return decode(ask(encode(decode(GOLDEN["reset"]) | {"session": session})))["type"]


def test_idle_sessions_make_room_and_then_nobody_does(ask) -> None:
    for number in range(SESSIONS):
        assert hello(ask, str(number))["type"] == "welcome"
        if number != 1:
            assert begins(ask, str(number)) == "observations"
    assert hello(ask, "a")["type"] == "welcome"
    gone = decode(ask(encode(decode(GOLDEN["step"]) | {"session": "1"})))
    assert (gone["type"], gone["lost"]) == ("error", True)
    assert begins(ask, "a") == "observations"
    assert hello(ask, "b") == {
        "type": "refusal",
        "reason": "All sessions are in use.",
        "full": True,
    }
    assert begins(ask, "0") == "observations"
    ask(encode(decode(GOLDEN["close"]) | {"session": "0"}))
    assert hello(ask, "b")["type"] == "welcome"


@pytest.mark.parametrize("patience", [("0",)])
def test_a_worker_that_is_silent_makes_room_though_its_episode_is_not_over(ask) -> None:
    for number in range(SESSIONS):
        hello(ask, str(number))
        begins(ask, str(number))
    assert begins(ask, "0") == "observations"
    assert hello(ask, "a")["type"] == "welcome"
    assert begins(ask, "0") == "observations"
    assert begins(ask, "1") == "error"


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=300)
@given(
    st.sampled_from(["hello", "reset", "step"]),
    st.integers(0, 400),
    st.integers(0, 255),
)
def test_spoilt_requests_are_answered_and_nothing_else(ask, name, place, byte) -> None:
    ask(GOLDEN["hello"])
    spoilt = bytearray(GOLDEN[name])
    spoilt[place % len(spoilt)] = byte
    assert decode(ask(bytes(spoilt)), strict=False)["type"] in {
        *("welcome", "refusal", "observations", "closed", "error"),
    }


def test_missed_detections_make_the_example_collide(compiled, start, engine) -> None:
    """The campaign of the bridge in JavaScript fits, whose scenario and planner are the same."""
    address = start(compiled(BRIDGES / "cpp" / "main.cpp")).address
    spec = read_spec(BRIDGES / "javascript" / "campaign.toml")
    tasks = [EpisodeTask(i, episode_seed(1, i), PriorSource()) for i in range(40)]
    results = list(engine(spec, address).run(tasks))
    assert [each.fault for each in results] == [None] * len(tasks)
    missed = [each.noise.injected[:, 2].sum() for each in results]
    failed = [many for many, each in zip(missed, results, strict=True) if each.is_failure]
    assert 0 < len(failed) < len(tasks)
    assert np.mean(failed) > np.mean(missed)
