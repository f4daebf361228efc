"""Bridges that die, hang or talk nonsense: an episode fails, the worker goes on."""

import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from threading import Thread

import pytest
import zmq
from msgspec.msgpack import encode
from msgspec.structs import replace

from eigenfail.errors import SimulatorError
from eigenfail.values.episode import EpisodeResult, EpisodeTask, PriorSource
from eigenfail_workers.bridge.connection import Connection

MISBEHAVING = Path(__file__).parent / "misbehaving.py"
REFERENCE = Path(__file__).parents[3] / "examples" / "bridge" / "minimal.py"
PATIENCE_S = 30.0
SOON_S = 2.0

SAID = {
    "hangs": ("simulator", "did not answer within 2 s"),
    "garbage": ("simulator", "cannot be read"),
    "empty": ("simulator", "cannot be read"),
    "nan": ("simulator", "cannot be read: Expected `float`"),
    "jumps": ("simulator", "shows step 7 where step 6 is due"),
    "another id": ("simulator", "answered another question"),
    "too few": ("simulator", "answered for 0 of 1 slots"),
    "welcomes": ("simulator", "said welcome in the middle of episodes"),
    "closes": ("simulator", "answered another question"),
    "planner": ("planner", "No more."),
    "solver": ("solver", "No more."),
    "input": ("input", "No more."),
}


def task(index: int) -> EpisodeTask:
    return EpisodeTask(index, index, PriorSource())


def check_fault(how: str, result: EpisodeResult) -> None:
    kind, said = SAID[how]
    assert result.fault.kind == kind
    assert said in result.fault.message
    assert result.steps > 0  # what there was of it is kept


@pytest.fixture(scope="module")
def lasting() -> Iterator[str]:
    """A bridge that goes wrong again and again, and stays."""
    address = f"ipc:///tmp/eigenfail-misbehaving-{os.getpid()}"
    program = subprocess.Popen([sys.executable, MISBEHAVING, address])
    yield address
    program.kill()
    program.wait()


@pytest.mark.parametrize("how", [how for how in SAID if how != "hangs"])
def test_an_episode_fails_with_the_right_blame_and_the_next_begins_anew(
    how: str, lasting: str, on_bridge
) -> None:
    (result,) = on_bridge(lasting, scenario=how).run([task(0)])
    check_fault(how, result)
    engine = on_bridge(lasting)
    assert [each.fault for each in engine.run([task(1), task(2)])] == [None, None]


def test_after_a_restart_the_next_episode_begins_anew(free_address, run_program, on_bridge) -> None:
    bad = run_program(MISBEHAVING, free_address)
    engine = on_bridge(free_address, scenario="hangs", answer_s=SOON_S)
    list(on_bridge(free_address).run([task(0)]))  # it has loaded what it needs
    (result,) = engine.run([task(0)])
    check_fault("hangs", result)
    bad.kill()
    bad.wait()
    run_program(REFERENCE, free_address)
    (result,) = on_bridge(free_address).run([task(1)])
    assert result.fault is None


def test_a_bridge_may_be_restarted_while_nothing_runs(
    free_address: str, run_program, on_bridge
) -> None:
    engine = on_bridge(free_address)
    for index in range(2):
        program = run_program(REFERENCE, free_address)
        (result,) = engine.run([task(index)])
        assert result.fault is None
        program.kill()
        program.wait()
        assert engine._connection.get(PATIENCE_S)._monitor.poll(PATIENCE_S * 1000)


def test_where_no_bridge_is_each_episode_waits_once_and_fails(free_address, on_bridge) -> None:
    engine = on_bridge(free_address, hello_s=0.2)
    results = list(engine.run([task(0), task(1)]))
    assert [each.fault.kind for each in results] == ["infrastructure"] * 2
    assert "did not answer within 0.2 s" in results[0].fault.message


def test_a_bridge_that_comes_up_late_is_waited_for(free_address, run_program, on_bridge) -> None:
    run_program(REFERENCE, free_address)
    (result,) = on_bridge(free_address).run([task(0)])
    assert result.fault is None


@pytest.mark.parametrize("whose", ["of the episode", "of the answer"])
def test_an_episode_that_takes_too_long_is_given_up(whose: str, serving, on_bridge) -> None:
    with serving() as address:
        engine = on_bridge(address)
        engine.begin(task(0))
        none_left = replace(engine._connection.timeouts, episode_s=0.0)
        if whose == "of the episode":
            engine._connection.get(PATIENCE_S).timeouts = none_left
        else:
            engine._connection.timeouts = none_left
        (result,) = engine.turn()
    assert result.fault.kind == "simulator"
    assert f"The bridge at {address} took longer than" in result.fault.message
    assert "give the worker a longer --episode-limit than 60 s" in result.fault.message


@pytest.mark.parametrize(
    ("answer", "said"),
    [
        ({"type": "refusal", "reason": "We are\nfull."}, "refuses: We are full."),
        ({"type": "closed", "id": 0}, "answered a hello with closed"),
        ("welcome 1", "speaks protocol 1, not protocol 2. Change the bridge to protocol 2"),
        ("welcome 3", "speaks protocol 3, not protocol 2. Change the bridge to protocol 2"),
    ],
)
def test_who_does_not_let_us_in_says_why(answer, said, minimal) -> None:
    given = answer
    if isinstance(answer, str):
        given = {**minimal.welcome(), "protocol": int(answer.removeprefix("welcome "))}
    with zmq.Context.instance().socket(zmq.ROUTER) as server:
        port = server.bind_to_random_port("tcp://127.0.0.1")
        server.linger = 0
        address = f"tcp://127.0.0.1:{port}"
        with pytest.raises(SimulatorError, match=said):
            answered(server, address, encode(given))


def answered(server, address: str, answer: bytes) -> None:
    """Open a connection whose hello is answered so."""

    def reply() -> None:
        identity, delimiter, _hello = server.recv_multipart()
        server.send_multipart((identity, delimiter, answer))

    thread = Thread(target=reply)
    thread.start()
    try:
        Connection(address).close()
    finally:
        thread.join()
