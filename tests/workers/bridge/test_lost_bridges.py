"""Bridges that are killed, restarted or full: no episode is to blame, and all of them are run."""

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from msgspec.structs import replace

from eigenfail.values.disturbance import DisturbanceModel
from eigenfail.values.episode import EpisodeResult, EpisodeSetup, EpisodeTask, PriorSource
from eigenfail_workers.bridge.engine import BridgeEngine
from eigenfail_workers.engine import Engine

EXAMPLES = Path(__file__).parents[3] / "examples" / "bridge"
REFERENCE = EXAMPLES / "minimal.py"
SOON_S = 0.5
POISON = 3
POISONED = f"""
import os, sys
sys.path.insert(0, sys.argv[2])
import minimal

class Poisoned(minimal.Bridge):
    # The episode of one seed ends the process in its second step.
    deadly = set()

    def reset(self, held, asked):
        (self.deadly.add if asked["seed"] == {POISON} else self.deadly.discard)(asked["slot"])
        return super().reset(held, asked)

    def step(self, held, asked):
        seen = super().step(held, asked)
        if asked["slot"] in self.deadly and seen["step"] == 2:
            os._exit(1)
        return seen

minimal.serve(sys.argv[1], Poisoned(minimal.welcome(4), minimal.built_in))
"""
FOR_EVER = 'while :; do "$@"; echo ended; done'


def tasks(episodes: int) -> list[EpisodeTask]:
    return [EpisodeTask(index, index, PriorSource()) for index in range(episodes)]


def digests(results: list[EpisodeResult]) -> dict[int, str]:
    assert [each.fault for each in results if each.fault] == []
    return {each.index: each.digest() for each in results}


@pytest.fixture(scope="module")
def undisturbed() -> dict[int, str]:
    """What the episodes are in the same world built in."""
    setup = EpisodeSetup("highway", "cut_in", {}, "idm", {}, DisturbanceModel())
    return digests(list(Engine(setup).run(tasks(8))))


def turned(engines: list[BridgeEngine], times: int) -> list[EpisodeResult]:
    return [each for _ in range(times) for engine in engines for each in engine.turn()]


def finished(engines: list[BridgeEngine], episodes: int) -> list[EpisodeResult]:
    found: list[EpisodeResult] = []
    while len(found) < episodes:
        found += turned(engines, 1)
    return found


def filled(engines: list[BridgeEngine], episodes: int) -> None:
    """Begin them, in turn."""
    for number, task in enumerate(tasks(episodes)):
        engines[number % len(engines)].begin(task)


@pytest.mark.fault(
    "SIGKILL of a bridge",
    group="processes",
    outcome="Its episodes start again when it is back; none is errored, and the campaign "
    "keeps its digest. If it stays away for the time limit of an episode, they are "
    "errored, kind `infrastructure`.",
)
@pytest.mark.parametrize("sessions", [8, 1])
def test_a_bridge_that_is_killed_costs_no_episode(
    sessions: int, free_address: str, run_program, on_bridge, undisturbed
) -> None:
    program = run_program(REFERENCE, free_address)
    engines = [on_bridge(free_address) for _ in range(sessions)]
    filled(engines, 8)
    assert turned(engines, 20) == []
    program.kill()
    program.wait()
    run_program(REFERENCE, free_address)
    results = finished(engines, 8)
    assert digests(results) == undisturbed
    assert turned(engines, 3) == []


@pytest.fixture
def poisoned(free_address: str) -> Iterator["subprocess.Popen[str]"]:
    """A bridge that somebody starts again whenever it ends."""
    words = ["sh", "-c", FOR_EVER, "sh", sys.executable, "-c", POISONED, free_address, EXAMPLES]
    program = subprocess.Popen(
        [*map(str, words)], stdout=subprocess.PIPE, text=True, start_new_session=True
    )
    yield program
    os.killpg(program.pid, signal.SIGKILL)
    program.communicate()


@pytest.mark.fault(
    "episode that kills its bridge",
    group="processes",
    outcome="After the second time it runs alone, after the third it is errored, kind "
    "`infrastructure`. The episodes that ran beside it are not affected.",
)
def test_an_episode_that_kills_the_bridge_is_found_out_and_alone_pays(
    poisoned, free_address, on_bridge, undisturbed
) -> None:
    *others, last = on_bridge(free_address).run([*tasks(3), *tasks(8)[4:], tasks(8)[POISON]])
    assert digests(others) == {k: v for k, v in undisturbed.items() if k != POISON}
    assert (last.index, last.fault.kind) == (POISON, "infrastructure")
    assert "It was loss no. 3 while this episode ran, the last time alone." in last.fault.message
    assert [poisoned.stdout.readline() for _ in range(3)] == ["ended\n"] * 3
    os.killpg(poisoned.pid, signal.SIGKILL)
    assert poisoned.stdout.read() == ""


@pytest.mark.fault("SIGKILL of a bridge")
def test_a_bridge_that_does_not_come_back_is_not_waited_for_longer_than_an_episode(
    free_address: str, run_program, on_bridge
) -> None:
    program = run_program(REFERENCE, free_address)
    engine = on_bridge(free_address)
    filled([engine], 3)
    program.kill()
    program.wait()
    engine._connection.timeouts = replace(
        engine._connection.timeouts, episode_s=SOON_S, hello_s=SOON_S
    )
    results = finished([engine], 3)
    assert sorted(each.index for each in results) == [0, 1, 2]
    assert {each.fault.kind for each in results} == {"infrastructure"}
    assert "did not answer within" in results[0].fault.message


def test_a_session_that_was_forgotten_is_begun_anew(
    serving, on_bridge, minimal, monkeypatch, undisturbed
) -> None:
    monkeypatch.setattr(minimal, "MOST_SESSIONS", 1)
    with serving() as address:
        first, second = on_bridge(address), on_bridge(address)
        found = [*first.run(tasks(1)), *second.run(tasks(2)[1:]), *first.run(tasks(3)[2:])]
    assert digests(found) == {index: undisturbed[index] for index in range(3)}


def test_a_full_bridge_is_waited_for(serving, on_bridge, minimal, monkeypatch, undisturbed) -> None:
    monkeypatch.setattr(minimal, "MOST_SESSIONS", 1)
    with serving() as address, ThreadPoolExecutor() as apart:
        first, second = on_bridge(address), on_bridge(address)
        first.begin(tasks(1)[0])
        assert turned([first], 20) == []
        (refused,) = on_bridge(address, episode_s=SOON_S).run(tasks(1))
        assert refused.fault.kind == "infrastructure"
        assert "has no room: All sessions are in use." in refused.fault.message
        waits = apart.submit(lambda: list(second.run(tasks(2)[1:])))
        results = finished([first], 1) + waits.result()
    assert digests(results) == {index: undisturbed[index] for index in range(2)}
