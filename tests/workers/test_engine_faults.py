"""Whatever breaks costs one episode, is blamed on the right part, and leaves nothing behind."""

import os
import signal
from collections.abc import Callable
from math import nan
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest

from eigenfail import plugins
from eigenfail.contracts import EpisodeEngine
from eigenfail.errors import ServiceError, SolverError
from eigenfail.values.disturbance import DisturbanceModel
from eigenfail.values.episode import (
    EpisodeResult,
    EpisodeSetup,
    EpisodeTask,
    Outcome,
    PolicySource,
    PriorSource,
    TrajectorySource,
    episode_seed,
)
from eigenfail.values.scene import Control, Observation, VehicleState
from eigenfail_workers.engine import Engine

MakeEngine = Callable[..., EpisodeEngine]

SIMULATORS = ("highway", "point_mass")


def tasks(n: int) -> list[EpisodeTask]:
    return [EpisodeTask(i, episode_seed(11, i), PriorSource()) for i in range(n)]


def run(engine: EpisodeEngine, todo: list[EpisodeTask]) -> list[EpisodeResult]:
    return list(engine.run(todo))


def digests(results: list[EpisodeResult]) -> list[str]:
    return [result.digest() for result in results]


def raising(error: BaseException) -> Callable[[], Any]:
    def wrong() -> Any:
        raise error

    return wrong


FAULTS = {
    "raises": (raising(ZeroDivisionError("on purpose")), "planner"),
    "is in trouble elsewhere": (raising(ServiceError("no route")), "planner"),
    "gives up": (raising(SolverError("no solution")), "solver"),
    "exits": (raising(SystemExit(0)), "planner"),
    "ends its generator": (raising(GeneratorExit()), "planner"),
    "interrupts": (raising(KeyboardInterrupt()), "planner"),
    "raises what it likes": (raising(BaseException("own")), "planner"),
    "returns nothing": (lambda: None, "planner"),
    "returns nan": (lambda: Control(nan, 0.0), "planner"),
}


def ignore_ctrl_c(monkeypatch: pytest.MonkeyPatch) -> None:
    """As in the inner process of a worker."""
    monkeypatch.setattr(signal, "getsignal", lambda _number: signal.SIG_IGN)


@pytest.mark.fault(
    "planner that raises, or returns nothing or NaN",
    group="plug-ins",
    outcome="The episode is errored, kind `planner`; the others run.",
)
@pytest.mark.parametrize("simulator", SIMULATORS)
@pytest.mark.parametrize("name", FAULTS)
def test_a_planners_fault_costs_one_episode(
    name: str,
    simulator: str,
    make_engine: MakeEngine,
    faulty: Callable[..., type],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    wrong, kind = FAULTS[name]
    ignore_ctrl_c(monkeypatch)
    expected = run(make_engine(simulator=simulator), tasks(5))
    results = run(make_engine(faulty(wrong), simulator=simulator), tasks(5))
    failed = results[1::2]
    assert digests(results[::2]) == digests(expected[::2])
    assert {(r.outcome, r.fault.kind, r.steps) for r in failed} == {(Outcome.ERRORED, kind, 5)}
    for result, sound in zip(failed, expected[1::2], strict=True):
        assert (result.measures, result.scene, result.states) == (None, None, None)
        assert np.array_equal(result.noise.z, sound.noise.z[:5])


@pytest.mark.fault(
    "planner that cannot be constructed",
    group="plug-ins",
    outcome="Its episodes are errored, kind `planner`, with the cause.",
)
def test_a_planner_that_cannot_be_made_fails_its_episodes(make_engine: MakeEngine) -> None:
    class Unmakeable:
        class Settings(msgspec.Struct, frozen=True):
            """None."""

        def __init__(self, settings: Settings) -> None:
            raise OSError("no weights")

    (result,) = run(make_engine(Unmakeable), tasks(1))
    assert (result.fault.kind, result.steps) == ("planner", 0)
    assert "OSError: no weights" in result.fault.message
    assert result.noise.z.shape == (0, 2)


INPUTS = {
    "an unknown policy version": PolicySource(7),
    "a flat trajectory": TrajectorySource(np.zeros(4, np.float32)),
    "a trajectory with nan": TrajectorySource(np.full((3, 2), nan, np.float32)),
}


@pytest.mark.fault("unknown policy version")
@pytest.mark.parametrize("name", INPUTS)
def test_wrong_input_costs_one_episode(name: str, make_engine: MakeEngine) -> None:
    before, after = tasks(2)
    engine = make_engine()
    results = run(engine, [before, EpisodeTask(9, 9, INPUTS[name]), after])
    assert [result.outcome for result in results][1] is Outcome.ERRORED
    assert results[1].fault.kind == "input"
    assert digests([results[0], results[2]]) == digests(run(make_engine(), [before, after]))


@pytest.mark.fault(
    "scenario that cannot be staged",
    group="plug-ins",
    outcome="The episode is errored, kind `input`.",
)
def test_a_scenario_that_cannot_be_staged_is_the_inputs_fault(make_engine: MakeEngine) -> None:
    (empty,) = run(make_engine(scenario="empty"), tasks(1))
    assert empty.fault.kind == "input"
    assert "no vehicle beside the ego" in empty.fault.message


class Trouble:
    """A simulator that works but for what its subclasses break in every second episode."""

    def open(self, scenario: Any, parameters: Any, planner: Any, channels: Any) -> "Trouble":
        real = plugins.load(plugins.SIMULATORS, "point_mass")()
        self.real = real.open(scenario, parameters, planner, channels)
        self.dt_s, self.steps = self.real.dt_s, self.real.steps
        self.episode = getattr(self, "episode", 0)
        return self

    def reset(self, seed: int) -> Any:
        self.episode += 1
        return self.real.reset(seed)

    def step(self, disturbance: tuple[float, float]) -> Any:
        seen = self.real.step(disturbance)
        return self.spoil(seen) if self.episode % 2 == 0 else seen

    def spoil(self, seen: Any) -> Any:
        raise ConnectionError("lost")

    def close(self) -> None:
        raise OSError("cannot close either")


class Exits(Trouble):
    def spoil(self, seen: Any) -> Any:
        raise SystemExit(3)

    def close(self) -> None:
        raise SystemExit(4)


class Endless(Trouble):
    def spoil(self, seen: Any) -> Any:
        return msgspec.structs.replace(seen, ended=False)


class Nowhere(Trouble):
    def spoil(self, seen: Any) -> Any:
        return msgspec.structs.replace(seen, ego=msgspec.structs.replace(seen.ego, x_m=nan))


class Deserted(Trouble):
    def spoil(self, seen: Any) -> Any:
        return msgspec.structs.replace(seen, others=())


@pytest.mark.fault(
    "simulator that raises, never ends or returns NaN",
    group="plug-ins",
    outcome="The episode is errored, kind `simulator`; the others run.",
)
@pytest.mark.parametrize(
    ("simulator", "told"),
    [
        (Trouble, "ConnectionError: lost"),
        (Exits, "SystemExit: 3"),
        (Endless, "did not end at its horizon"),
        (Nowhere, "finite"),
        (Deserted, "Look into"),
    ],
)
def test_a_simulators_fault_costs_one_episode(
    simulator: type, told: str, make_engine: MakeEngine, plug_in: Callable[..., None]
) -> None:
    one = simulator()
    plug_in(plugins.SIMULATORS, "trouble", lambda: one)
    engine = make_engine(simulator="trouble")
    results = run(engine, tasks(4))
    expected = run(make_engine(), tasks(4))
    assert [result.outcome is Outcome.ERRORED for result in results] == [False, True, False, True]
    assert digests(results[::2]) == digests(expected[::2])
    assert results[1].fault.kind == "simulator"
    assert told in results[1].fault.message
    one.close = lambda: None


class Growing:
    """A stranger's simulator, in which vehicles appear from nowhere."""

    def open(self, scenario: Any, parameters: Any, planner: Any, channels: Any) -> "Growing":
        self.dt_s, self.steps = 0.1, 2
        return self

    def reset(self, seed: int) -> Observation:
        return self._observe(0)

    def step(self, disturbance: tuple[float, float]) -> Observation:
        return self._observe(self._step + 1)

    def _observe(self, step: int) -> Observation:
        self._step = step
        ego = VehicleState(0.0, 0.0, 0.0, 10.0, 5.0, 2.0)
        others = tuple(VehicleState(50.0 + i, 0.0, 0.0, 10.0, 5.0, 2.0) for i in range(step + 1))
        return Observation(step, ego, others, ended=step == self.steps)

    def close(self) -> None:
        pass


@pytest.mark.fault("simulator that raises, never ends or returns NaN")
def test_a_scene_that_cannot_be_kept_is_the_simulators_fault(make_engine, plug_in) -> None:
    plug_in(plugins.SIMULATORS, "growing", Growing)
    (result,) = run(make_engine(simulator="growing"), tasks(1))
    assert (result.outcome, result.fault.kind) == (Outcome.ERRORED, "simulator")


class Moving(Trouble):
    """A simulator that changes the directory, and then breaks."""

    def spoil(self, seen: Any) -> Any:
        os.chdir("/")
        raise ConnectionError("lost")


@pytest.mark.fault(
    "simulator that changes process-wide state",
    group="plug-ins",
    outcome="The episode is errored, and its fault names the simulator and what it changed.",
)
def test_a_simulator_that_changes_the_process_is_named(
    plug_in: Callable[..., None], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.chdir(tmp_path)
    one = Moving()
    plug_in(plugins.SIMULATORS, "moving", lambda: one)
    engine = Engine(EpisodeSetup("moving", "cut_in", {}, "idm", {}, DisturbanceModel()))
    sound, result = run(engine, tasks(2))
    assert sound.fault is None
    assert result.fault.kind == "simulator"
    assert "The simulator 'moving' changed process-wide state" in result.fault.message
    assert " and is /. The episode ended with: " in result.fault.message
    assert "ConnectionError: lost" in result.fault.message
    one.close = lambda: None


def test_of_several_plug_ins_all_are_named(
    make_engine: MakeEngine,
    faulty: Callable[..., type],
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
) -> None:
    monkeypatch.chdir(tmp_path)

    def move() -> Control:
        os.chdir("/")
        return Control(0.0, 0.0)

    _, result = run(make_engine(faulty(move)), tasks(2))
    assert result.fault.kind == "planner"
    assert result.fault.message.startswith(
        "The planner 'driver' or the scenario 'small' changed process-wide state"
    )
