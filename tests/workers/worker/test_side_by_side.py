"""The inner process of a worker with engines that run several episodes at a time."""

import os
import subprocess
import sys
from collections.abc import Iterator
from io import BytesIO
from pathlib import Path
from unittest.mock import Mock

import deadlines
import numpy as np
import pytest
from msgspec.structs import replace

from eigenfail.testing.examples import result
from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail.values.episode import EpisodeFault, EpisodeTask, Outcome, PriorSource, episode_seed
from eigenfail.wire.messages import (
    Drop,
    Heartbeat,
    Hello,
    Lease,
    Results,
    Setup,
    Welcome,
    read_worker_message,
)
from eigenfail_workers.bridge.connection import Connection, make_timeouts
from eigenfail_workers.limits import RENEWAL
from eigenfail_workers.worker.child import Child, as_lockstep, serve
from eigenfail_workers.worker.child_process import FrameBuffer, write_message

BRIDGE = Path(__file__).parents[3] / "examples" / "bridge" / "minimal.py"
SPEC = CampaignSpec(name="t", method="monte_carlo", episodes=99, planner="idm")
ON_BRIDGE = replace(SPEC, simulator="bridge", scenario_parameters={"steps": 100})


def lease(campaign: int, *indices: int) -> Lease:
    tasks = (EpisodeTask(i, episode_seed(0, i), PriorSource()) for i in indices)
    return Lease(campaign, tuple(tasks))


class Three:
    """Runs three episodes side by side: in each turn the youngest is over."""

    def __init__(self, *_) -> None:
        self.running: list[EpisodeTask] = []

    @property
    def room(self) -> int:
        return 3 - len(self.running)

    def begin(self, task: EpisodeTask) -> None:
        assert self.room > 0
        self.running.append(task)

    def turn(self):
        task = self.running.pop()
        return [replace(result(task.index % 50, seed=task.seed), index=task.index)]

    def add_policy(self, policy) -> None: ...

    def run(self, tasks): ...

    def close(self) -> None:
        assert not self.running


@pytest.fixture
def played():
    """A child without a pipe, and what it has said since one asked last."""
    out, buffer = BytesIO(), FrameBuffer()
    child = Child(out, Three)

    def said() -> list[tuple[str, int]]:
        buffer._bytes += out.getvalue()
        out.seek(0)
        out.truncate()
        heard = [read_worker_message(frame) for frame in buffer.frames()]
        found = []
        for message in heard:
            if isinstance(message, Heartbeat):
                found.append(("begins", message.running))
            else:
                found += [("ends", each.index) for each in message.results]
        return found

    return child, said


def test_as_many_begin_as_there_is_room_for_and_the_next_when_one_is_over(played) -> None:
    child, said = played
    child.handle(Setup(1, SPEC.setup()))
    child.handle(lease(1, 0, 1, 2, 3))
    child.turn()
    assert said() == [("begins", 0), ("begins", 1), ("begins", 2), ("ends", 2)]
    child.turn()
    assert said() == [("begins", 3), ("ends", 3)]
    child.turn()
    child.turn()
    assert said() == [("ends", 1), ("ends", 0)]
    assert not child.is_busy


def test_the_episodes_of_two_campaigns_are_not_mixed(played) -> None:
    child, said = played
    child.handle(Setup(1, SPEC.setup()))
    child.handle(Setup(2, SPEC.setup()))
    child.handle(lease(1, 0, 1))
    child.handle(lease(2, 7))
    child.turn()
    child.turn()
    assert said() == [("begins", 0), ("begins", 1), ("ends", 1), ("ends", 0)]
    child.turn()
    assert said() == [("begins", 7), ("ends", 7)]


def test_what_was_leased_is_run_before_its_campaign_is_forgotten(played) -> None:
    child, said = played
    child.handle(Setup(1, SPEC.setup()))
    child.handle(lease(1, 0, 1, 2, 3, 4))
    child.turn()
    child.handle(Drop(1))
    assert sorted(index for what, index in said() if what == "ends") == [0, 1, 2, 3, 4]
    assert not child.is_busy


@pytest.mark.fault("campaign with a name that the bridge does not know")
def test_a_campaign_that_the_engine_declines_is_run_no_further(played) -> None:
    child, _ = played
    child.handle(Setup(1, SPEC.setup()))
    child.handle(Setup(2, SPEC.setup()))
    engine = child._engines[1]
    engine.turn = lambda: setattr(engine, "declined", "'gap' is not known.") or [result(0)]
    engine.close = lambda: None
    child.handle(lease(1, 0, 1, 2, 3))
    child.handle(lease(2, 7))
    child.turn()
    child.handle(lease(1, 4))  # it was on its way
    while child.is_busy:
        child.turn()
    frames = FrameBuffer()
    frames._bytes += child._out.getvalue()
    heard = [read_worker_message(frame) for frame in frames.frames()]
    assert [each.declined for each in heard if isinstance(each, Heartbeat) and each.declined] == [
        ((1, "'gap' is not known."),)
    ]
    brought = [
        (each.campaign, each.results[0].index) for each in heard if isinstance(each, Results)
    ]
    assert brought == [(2, 7)]
    child.handle(Drop(1))
    child.handle(Setup(1, SPEC.setup()))
    child.handle(lease(1, 4))
    assert child.is_busy


class Changing(Three):
    """Runs one episode at a time, which changes the process."""

    @property
    def room(self) -> int:
        return 1 - len(self.running)

    def turn(self):
        np.seterr(over="raise")
        return [replace(each, fault=EpisodeFault("planner", "changes")) for each in super().turn()]


def test_no_episode_begins_in_a_process_that_one_before_a_drop_has_changed(played) -> None:
    """A drop waits for all that was leased before it, but not in a process that was changed."""
    child, said = played
    child.handle(Setup(1, SPEC.setup()))
    child._engines[1] = Changing()
    reader, writer = os.pipe()
    with np.errstate(), os.fdopen(writer, "wb") as pipe:
        for message in (lease(1, 0, 1), Drop(2)):
            write_message(pipe, message)
        assert serve(child, reader) == RENEWAL
    os.close(reader)
    assert said() == [("begins", 0), ("ends", 0)]


@pytest.mark.fault("simulator that raises, never ends or returns NaN")
def test_an_engine_that_cannot_be_made_costs_no_process(played) -> None:
    child, _ = played
    child._make_engine = Mock(side_effect=RuntimeError("no licence"))
    child.handle(Setup(1, SPEC.setup()))
    child.handle(lease(1, 0))
    child.turn()
    frames = FrameBuffer()
    frames._bytes += child._out.getvalue()
    ((brought,),) = [read_worker_message(frame).results for frame in frames.frames()]
    assert brought.fault.kind == "simulator"
    assert "raised RuntimeError: no licence." in brought.fault.message
    assert not child.is_busy


MISSPELT = {"steps": 100, "gap_m": 50.0}


@pytest.mark.fault("campaign with a name that the bridge does not know")
def test_a_misspelt_parameter_is_declined_with_every_heartbeat_until_it_is_dropped(
    hub, start_worker, bridge
) -> None:
    start_worker("--bridge", bridge)
    hub.hear(Hello)
    wrong = replace(ON_BRIDGE, scenario_parameters=MISSPELT).setup()
    hub.say(Welcome(1.0), Setup(1, wrong), lease(1, *range(9)))
    beats = []
    while len(beats) < 2:
        if (beat := hub.hear(Heartbeat)).declined:
            beats.append(beat)
    for beat in beats:
        ((campaign, reason),) = beat.declined
        assert campaign == 1
        assert "'gap_m' is not known" in reason
        assert "distance_m" in reason
        assert beat.held == ()
    hub.say(Drop(1), Setup(1, ON_BRIDGE.setup()), lease(1, 0))
    assert hub.hear(Results).results[0].outcome is not Outcome.ERRORED


@pytest.mark.fault("campaign with a name that the bridge does not know")
def test_a_declined_campaign_is_tried_again_where_the_drop_did_not_arrive(
    hub, start_worker, bridge
) -> None:
    start_worker("--bridge", bridge)
    hub.hear(Hello)
    wrong = replace(ON_BRIDGE, scenario_parameters=MISSPELT).setup()
    hub.say(Welcome(1.0), Setup(1, wrong), lease(1, 0))
    while not hub.hear(Heartbeat).declined:
        pass
    hub.say(Setup(1, ON_BRIDGE.setup()), lease(1, 0))
    assert hub.hear(Results).results[0].outcome is not Outcome.ERRORED


def test_an_engine_of_one_at_a_time_has_room_for_one() -> None:
    class Plain:
        def run(self, tasks):
            return (replace(result(task.index), index=task.index) for task in tasks)

        def add_policy(self, policy) -> None: ...

        def close(self) -> None: ...

    engine = as_lockstep(Plain())
    assert engine.room == 1
    assert engine.turn() == []
    engine.begin(*lease(1, 4).tasks)
    assert engine.room == 0
    assert [each.index for each in engine.turn()] == [4]
    assert engine.room == 1


@pytest.fixture
def bridge(tmp_path: Path) -> Iterator[str]:
    """The reference bridge as a program of its own; where it listens."""
    address = f"ipc://{tmp_path}/b"
    program = subprocess.Popen([sys.executable, BRIDGE, address])
    yield address
    program.kill()
    program.wait()


def results_of(hub, n: int):
    found = []
    while len(found) < n:
        found += hub.hear(Results).results
    return found


@pytest.mark.service
def test_a_worker_runs_what_it_is_leased_on_its_bridge(hub, start_worker, bridge) -> None:
    start_worker("--bridge", bridge, "--name", "w")
    hub.hear(Hello)
    hub.say(Welcome(1.0), Setup(1, ON_BRIDGE.setup()), lease(1, *range(80)))
    on_bridge = {each.index: each.digest() for each in results_of(hub, 80)}
    hub.say(Setup(2, SPEC.setup()), lease(2, *range(80)))
    built_in = {each.index: each.digest() for each in results_of(hub, 80)}
    assert on_bridge == built_in


HANGS = BRIDGE.parents[2] / "tests" / "workers" / "bridge" / "misbehaving.py"


@pytest.mark.fault(
    "bridge that hangs",
    group="time",
    outcome="Its episodes are errored before the worker's own limit is reached; the message "
    "names the limit.",
)
@pytest.mark.service
def test_the_limit_of_an_episode_governs_the_bridge_too(hub, start_worker, tmp_path) -> None:
    address = f"ipc://{tmp_path}/b"
    with subprocess.Popen([sys.executable, HANGS, address]) as bridge:
        Connection(address, make_timeouts(600.0)).close()  # it is there
        start_worker("--bridge", address, "--episode-limit", "6")
        hub.hear(Hello)
        hangs = replace(ON_BRIDGE, scenario="hangs")
        hub.say(Welcome(1.0), Setup(1, hangs.setup()), lease(1, 0))
        (result,) = results_of(hub, 1)
        bridge.kill()
    assert result.fault.kind == "simulator"
    assert f"The bridge at {address} did not answer within 3 s." in result.fault.message
    assert "give the worker a longer --episode-limit than 6 s" in result.fault.message


@pytest.mark.service
def test_a_worker_without_a_bridge_says_so_for_each_episode(hub, start_worker) -> None:
    start_worker("--name", "w")
    hub.hear(Hello)
    hub.say(Welcome(1.0), Setup(1, ON_BRIDGE.setup()), lease(1, 0, 1), Setup(2, SPEC.setup()))
    for each in results_of(hub, 2):
        assert (each.outcome, each.fault.kind) == (Outcome.ERRORED, "input")
        assert "this worker has no bridge. Start it with --bridge ADDRESS" in each.fault.message
    hub.say(lease(2, 0))
    assert results_of(hub, 1)[0].fault is None


@pytest.mark.service
@pytest.mark.parametrize("address", ["tcp://10.1.2.3:9000", "nowhere"])
def test_a_worker_is_not_started_for_any_bridge(address, start_worker, tmp_path) -> None:
    assert start_worker("--bridge", address).wait(deadlines.PROCESS_S) == 2
    assert "--bridge: " in (tmp_path / "said").read_text()
