"""One episode with the planner's own explanation of each step. Registered as an explainer."""

import os
from collections.abc import Sequence
from contextlib import closing
from math import isnan

import msgspec

from eigenfail import bridges
from eigenfail.errors import InvalidValue
from eigenfail.explanations import find_only_vehicle, measure_gap
from eigenfail.values.channels import GHOST, SWAPPED, split_name
from eigenfail.values.episode import EpisodeResult, EpisodeSetup, EpisodeTask
from eigenfail.values.proof import ExplainedEpisode, ExplainedStep
from eigenfail.values.scene import Scene, VehicleState
from eigenfail.worlds import resolve_disturbance, world_of
from eigenfail_workers.accounts import RecordedStep, RecordingPlanner
from eigenfail_workers.bridge.connection import SharedConnection
from eigenfail_workers.bridge.engine import BridgeEngine
from eigenfail_workers.engine import Engine
from eigenfail_workers.measures.encounters import shares_path
from eigenfail_workers.measures.geometry import find_struck


def explain(setup: EpisodeSetup, task: EpisodeTask) -> ExplainedEpisode:
    """Run an episode and record the planner's explanations; see `Explainer`.

    Raises:
        InvalidValue: the campaign lacks a planner that could explain its decisions here.
        EpisodeError: the bridge of the campaign cannot be reached.
    """
    if why := world_of(setup.simulator).unexplained:
        raise InvalidValue("episode", why, "Run it again with `eigenfail episode replay`.")
    run = _run_on_bridge if world_of(setup.simulator).needs_bridge else _run_here
    recorded: list[RecordedStep] = []
    # The truth beside the account is read from the scene, which safe episodes may not keep.
    result = run(msgspec.structs.replace(setup, scene_every=1), task, recorded)
    channels = [split_name(each.name) for each in resolve_disturbance(setup).list_channels()]
    truth = TrueTraffic(result, [channel.quantity for channel in channels])
    steps = tuple([truth.explain_step(number, step) for number, step in enumerate(recorded)])
    return ExplainedEpisode(result, steps, truth.find_struck())


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
        # A bridge that is not there is an error of the question, and no fault of the episode.
        connection.get(connection.timeouts.hello_s)
        with closing(BridgeEngine(setup, connection, recorded)) as engine:
            return next(engine.run([task]))


class TrueTraffic:
    """The truth about the vehicles that a planner's account names.

    Args:
        result: of the episode.
        quantities: quantity of each channel of its noise.
    """

    def __init__(self, result: EpisodeResult, quantities: Sequence[str]) -> None:
        self._result = result
        self._only = None if GHOST in quantities else find_only_vehicle(result.scene)
        self._swaps = [place for place, name in enumerate(quantities) if name == SWAPPED]

    def explain_step(self, number: int, step: RecordedStep) -> ExplainedStep:
        """Return a step with the planner's account and the truth."""
        result, vehicle = self._result, self._find_vehicle(number, step)
        gap_m, closing_mps = measure_gap(result.scene, number, vehicle)
        return ExplainedStep(
            time_s=step.time_s,
            acceleration_mps2=step.control.acceleration_mps2,
            steering_rad=step.control.steering_rad,
            account=step.account,
            disturbance=tuple(result.noise.standardised[number].tolist()),
            gap_m=gap_m,
            closing_mps=closing_mps,
            path=step.path,
            vehicle=vehicle,
            ahead=self._find_ahead(number),
        )

    def _find_vehicle(self, number: int, step: RecordedStep) -> int | None:
        """Return the vehicle that an account is about; None if it may be another one."""
        # Two numbers were swapped in this step: the account names the other vehicle.
        if any(self._result.noise.injected[number, place] > 0.5 for place in self._swaps):
            return None
        named = step.account.get("vehicle")
        if isinstance(named, float):
            return int(named) if named.is_integer() and named > 0.0 else None
        return self._only if named is None else None

    def _find_ahead(self, number: int) -> int | None:
        """Return the next vehicle ahead in the path of the ego, or entering it."""
        if self._result.scene is None:
            return None
        ego, others = _list_vehicles(self._result.scene, number)
        ahead = {
            other.x_m: place
            for place, other in others.items()
            if other.x_m > ego.x_m and shares_path(ego, other)
        }
        return ahead[min(ahead)] if ahead else None

    def find_struck(self) -> int | None:
        """Return the vehicle that the ego struck; None without a collision."""
        scene, measures = self._result.scene, self._result.measures
        if scene is None or measures is None or measures.collided_s is None:
            return None
        ego, others = _list_vehicles(scene, self._result.steps)
        return list(others)[find_struck(ego, list(others.values()))]


def _list_vehicles(scene: Scene, step: int) -> tuple[VehicleState, dict[int, VehicleState]]:
    """Return the ego after a step, and the others that are there by number."""
    poses = zip(scene.vehicles[step].tolist(), scene.sizes.tolist(), strict=True)
    there = {
        number: VehicleState(*pose, *size)
        for number, (pose, size) in enumerate(poses)
        if not isnan(pose[0])
    }
    return there.pop(0), there
