"""One episode with the planner's own explanation of each step. Registered as an explainer."""

import os
from contextlib import closing
from math import isnan

import msgspec

from eigenfail import bridges
from eigenfail.errors import InvalidValue
from eigenfail.values import (
    EpisodeResult,
    EpisodeSetup,
    EpisodeTask,
    ExplainedEpisode,
    ExplainedStep,
    Scene,
    VehicleState,
)
from eigenfail.worlds import world_of
from eigenfail_workers.accounts import RecordedStep, RecordingPlanner
from eigenfail_workers.bridge.connection import SharedConnection
from eigenfail_workers.bridge.engine import BridgeEngine
from eigenfail_workers.bridge.messages import CHANNEL_PROTOCOL
from eigenfail_workers.engine import Engine
from eigenfail_workers.measures.geometry import find_nearest, velocity

REPLAY = "Run it again with `eigenfail episode replay`."


def explain(setup: EpisodeSetup, task: EpisodeTask) -> ExplainedEpisode:
    """Run an episode and record the planner's explanations; see `Explainer`.

    Raises:
        InvalidValue: the campaign has no planner that could explain anything here.
        EpisodeError: the bridge of the campaign cannot be reached.
    """
    if why := world_of(setup.simulator).unexplained:
        raise InvalidValue("episode", why, REPLAY)
    run = _run_on_bridge if world_of(setup.simulator).needs_bridge else _run_here
    recorded: list[RecordedStep] = []
    result = run(msgspec.structs.replace(setup, scene_every=1), task, recorded)
    steps = (_make_step(number, step, result) for number, step in enumerate(recorded))
    return ExplainedEpisode(result, tuple(steps))


def _run_here(
    setup: EpisodeSetup, task: EpisodeTask, recorded: list[RecordedStep]
) -> EpisodeResult:
    with closing(Engine(setup, lambda planner: RecordingPlanner(planner, recorded))) as engine:
        return next(engine.run([task]))


def _run_on_bridge(
    setup: EpisodeSetup, task: EpisodeTask, recorded: list[RecordedStep]
) -> EpisodeResult:
    """Run an episode in a new session: a worker of this process may have another one."""
    address = os.environ.get(bridges.ADDRESS_VARIABLE)
    if not address:
        problem = "this process knows no bridge that could explain the episode."
        remedy = f"Set {bridges.ADDRESS_VARIABLE} to its address where the services are started."
        raise InvalidValue("episode", problem, remedy)
    with closing(SharedConnection(address)) as connection:
        welcome = connection.get(connection.timeouts.hello_s).welcome
        if welcome.protocol < CHANNEL_PROTOCOL:
            problem = f"the bridge '{welcome.name}' speaks version 1, which explains nothing."
            raise InvalidValue("episode", problem, REPLAY)
        with closing(BridgeEngine(setup, connection, recorded)) as engine:
            return next(engine.run([task]))


def _make_step(number: int, step: RecordedStep, result: EpisodeResult) -> ExplainedStep:
    gap_m, closing_mps = _measure_gap(result.scene, number) if result.scene else (None, None)
    return ExplainedStep(
        time_s=step.time_s,
        acceleration_mps2=step.control.acceleration_mps2,
        steering_rad=step.control.steering_rad,
        account=step.account,
        disturbance=tuple(result.noise.standardised[number].tolist()),
        gap_m=gap_m,
        closing_mps=closing_mps,
        path=step.path,
    )


def _measure_gap(scene: Scene, step: int) -> tuple[float, float]:
    """Return the true gap to the nearest vehicle [m], and its closing speed [m/s]."""
    poses = zip(scene.vehicles[step].tolist(), scene.sizes.tolist(), strict=True)
    ego, *others = (VehicleState(*pose, *size) for pose, size in poses if not isnan(pose[0]))
    actor = others[find_nearest(ego, others)]
    gap_m = actor.x_m - ego.x_m - (ego.length_m + actor.length_m) / 2.0
    return gap_m, velocity(ego)[0] - velocity(actor)[0]
