"""Environments of highway-env: the policy observes the road with its perceived vehicles on it.

Vehicles are moved to their perceived positions, the environment makes its observation, and the
vehicles are moved back. So errors are in metres and metres a second whatever the observation is,
and however it is normalised, clipped or sorted.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
from highway_env.vehicle.kinematics import Vehicle
from msgspec.structs import replace

from eigenfail.errors import SimulatorError
from eigenfail.values.scene import (
    Control,
    LanePosition,
    Mission,
    Observation,
    Perception,
    VehicleState,
)
from eigenfail_gymnasium.environments import Environment
from eigenfail_gymnasium.stages import Advance, ChosenAction, PolicyTask, read_action

FAST_MPS = 30.0
"""Desired speed on a road without a limit: highway-env's `default_target_speed` is near it."""


class RoadStage:
    """An environment of highway-env. Implements `Stage`.

    Args:
        env: the environment.
        dt_s: duration of a step. [s]
        steps: horizon of an episode.
    """

    takes_controls = True

    def __init__(self, env: Environment, dt_s: float, steps: int) -> None:
        self._env = env
        self._world: Any = env.unwrapped
        self._dt_s, self._steps = dt_s, steps
        self._numbers: dict[int, int] = {}
        self._known: list[Any] = []
        self._frames: list[Observation] = []
        self._forced: Control | None = None
        self.mission = Mission(dt_s, 1, 4.0, FAST_MPS, FAST_MPS, 0.0)

    def reset(self, seed: int) -> Observation:
        """Begin an episode."""
        self._env.reset(seed=seed)
        self._numbers, self._known = {}, []
        self._follow_frames()
        start = self._read_truth(0)
        self.mission = self._brief(start.ego)
        return start

    def _brief(self, ego: VehicleState) -> Mission:
        """Return a mission with the lanes at the ego, as if they were parallel to x."""
        network, index = self._world.road.network, self._world.vehicle.lane_index
        lane, beside = network.get_lane(index), network.all_side_lanes(index)
        limit = float(lane.speed_limit or FAST_MPS)
        goal_m = ego.x_m + limit * self._steps * self._dt_s
        return Mission(self._dt_s, len(beside), float(lane.width_at(0.0)), limit, limit, goal_m)

    def _follow_frames(self) -> None:
        """Have every frame of the environment's physics recorded: it has several in a step."""
        road = self._world.road
        move = road.step

        def step(dt_s: float) -> None:
            ego = self._world.vehicle
            if self._forced is not None:
                # In place of what the ego's own controller made of the environment's action.
                least = -max(ego.speed, 0.0) / dt_s
                acceleration = max(self._forced.acceleration_mps2, least)
                ego.action = {
                    "acceleration": acceleration,
                    "steering": self._forced.steering_rad,
                }
            move(dt_s)
            if self._forced is not None:
                ego.speed = max(ego.speed, 0.0)
            self._frames.append(self._read_truth(0))

        road.step = step

    def describe(self) -> PolicyTask:
        """Return the task that a policy gets; needs a first observation of the environment."""
        kind, actions = self._world.observation_type, self._world.action_type
        named = getattr(actions, "actions_indexes", {})
        ranges = getattr(kind, "features_range", None) if getattr(kind, "normalize", False) else {}
        return PolicyTask(
            self._env.observation_space,
            self._env.action_space,
            self._dt_s,
            {str(name): int(number) for name, number in named.items()},
            tuple(getattr(kind, "features", ())),
            {name: (float(low), float(high)) for name, (low, high) in (ranges or {}).items()},
        )

    def observe(self, perception: Perception) -> Any:
        """Return the environment's observation of the perceived road."""
        with self._perceived(perception):
            return self._world.observation_type.observe()

    @contextmanager
    def _perceived(self, perception: Perception) -> Iterator[None]:
        """Move, hide and add vehicles as perceived, and undo this at the end of the block."""
        road, ego = self._world.road, self._world.vehicle
        seen = dict(zip(perception.ids, perception.others, strict=True))
        by_number = {self._numbers[id(each)]: each for each in self._list_others()}
        kept = [(each, dict(vars(each))) for each in (ego, *by_number.values())]
        vehicles, objects = road.vehicles, road.objects
        try:
            _place(ego, perception.ego)
            for number in by_number.keys() & seen.keys():
                _place(by_number[number], seen[number])
            missed = {id(each) for number, each in by_number.items() if number not in seen}
            ghosts = [
                _make_ghost(road, state)
                for number, state in seen.items()
                if number not in by_number
            ]
            road.vehicles = [each for each in vehicles if id(each) not in missed] + ghosts
            road.objects = [each for each in objects if id(each) not in missed]
            yield
        finally:
            road.vehicles, road.objects = vehicles, objects
            for each, attributes in kept:
                vars(each).clear()
                vars(each).update(attributes)

    def advance(self, before: Observation, answer: Control | ChosenAction) -> Advance:
        """Do one step of the environment, and show each frame of its physics.

        Raises:
            ValueError: the policy's answer is not an action of the environment.
        """
        self._frames = []
        if isinstance(answer, Control):
            self._forced, action = answer, self._find_idle()
        else:
            self._forced, action = None, read_action(answer, self._env.action_space)
        kind = self._world.observation_type
        # An observation of the true road takes half of the time of a step, and nobody sees it.
        kind.observe = _observe_nothing
        try:
            _, _, terminated, truncated, _ = self._env.step(action)
        finally:
            del kind.observe
        step = before.step + 1
        frames = [replace(each, step=step) for each in self._frames]
        crash = next((place for place, each in enumerate(frames) if each.collided), None)
        # After the step some environments take vehicles off the road, and bring new ones.
        last = replace(self._read_truth(step), collided=False) if crash is None else frames[crash]
        before_last = frames[: -1 if crash is None else crash]
        control = self._read_control(before, last)
        now = replace(last, control=control, frames=tuple(before_last))
        return Advance(now, bool(terminated or truncated))

    def _read_control(self, before: Observation, last: Observation) -> Control:
        """Return the mean acceleration of the step, and the last steering angle."""
        change_mps = last.ego.speed_mps - before.ego.speed_mps
        return Control(change_mps / self._dt_s, float(self._world.vehicle.action["steering"]))

    def _find_idle(self) -> Any:
        """Return an action that does not change the ego's lane."""
        idle = self.describe().actions.get("IDLE")
        return np.zeros(self._env.action_space.shape or (), np.float32) if idle is None else idle

    def _list_others(self) -> list[Any]:
        """Return the vehicles and solid objects besides the ego, numbered when first seen."""
        road = self._world.road
        solid = [each for each in road.objects if each.solid and each.collidable]
        others = [each for each in (*road.vehicles, *solid) if each is not self._world.vehicle]
        for each in others:
            if id(each) not in self._numbers:
                # Kept, so that no other vehicle gets the identity of one that has gone.
                self._known.append(each)
                self._numbers[id(each)] = len(self._known)
        return others

    def _read_truth(self, step: int) -> Observation:
        ego, others = self._world.vehicle, self._list_others()
        if not others:
            problem = "There is no vehicle beside the ego."
            raise SimulatorError(problem, "Configure one at least: noise is on the nearest.")
        along_m, offset_m = ego.lane.local_coordinates(ego.position)
        return Observation(
            step,
            _read_state(ego),
            tuple(map(_read_state, others)),
            collided=bool(ego.crashed),
            off_road=not ego.on_road,
            lane=LanePosition(float(offset_m), float(ego.lane.width_at(along_m))),
            ids=tuple([self._numbers[id(each)] for each in others]),
        )

    def close(self) -> None:
        """Close the environment."""
        self._env.close()


def _observe_nothing() -> None:
    """Replace the environment's observation, which is not used."""


def _read_state(vehicle: Any) -> VehicleState:
    x_m, y_m = map(float, vehicle.position)
    heading_rad, speed_mps = float(vehicle.heading), float(vehicle.speed)
    sizes = float(vehicle.LENGTH), float(vehicle.WIDTH)
    return VehicleState(x_m, y_m, heading_rad, speed_mps, *sizes)


def _place(vehicle: Any, state: VehicleState) -> None:
    """Move a vehicle to its perceived state; its lane stays, as do the plans of its driver."""
    # Exactly the truth for what is perceived without an error.
    vehicle.position = np.array([state.x_m, state.y_m])
    vehicle.heading, vehicle.speed = state.heading_rad, state.speed_mps
    vehicle.LENGTH, vehicle.WIDTH = state.length_m, state.width_m


def _make_ghost(road: Any, state: VehicleState) -> Any:
    ghost = Vehicle(road, np.array([state.x_m, state.y_m]), state.heading_rad, state.speed_mps)
    _place(ghost, state)
    return ghost
