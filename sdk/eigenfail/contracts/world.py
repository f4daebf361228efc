"""Contracts of what runs an episode: planner, scenario, simulator and engine."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, ClassVar, Protocol, runtime_checkable

import msgspec

from eigenfail.values.channels import Channel
from eigenfail.values.episode import EpisodeResult, EpisodeSetup, EpisodeTask
from eigenfail.values.learning import Policy
from eigenfail.values.proof import ExplainedEpisode, Path
from eigenfail.values.scene import Control, Mission, Observation, Perception, VehicleState


# Protocols, not base classes: planners of others need not import eigenfail to be one.
class Planner(Protocol):
    """The system under test. It keeps no state over a reset."""

    def reset(self, mission: Mission) -> None:
        """Forget everything, and begin a new episode."""

    def act(self, perception: Perception) -> Control:
        """Return the control of one step. Called every `dt_s` of the scenario, in order."""


class ExplainingPlanner(Planner, Protocol):
    """Optional: a planner that explains its decisions."""

    def explain(self) -> Mapping[str, str | float]:
        """Return an account of the last step in plain names and values, without changing state.

        Names are free, with units in them. `eigenfail episode explain` understands these, if given:
        `mode`, `candidate`, `rule`, `override` ("none" if there was none) and `qp_status` ("solved"
        if there was nothing wrong) in words; `heeds`, the role of the vehicle that it
        takes into account ("nobody" without one), with `gap_m` and `closing_mps` as it estimates
        them, and `vehicle`, the number of that vehicle in `Perception.ids`; `tracks`, the states of
        all tracks; `lost_tracks`, their losses since the reset, and `lost_vehicles`, a text with
        the numbers of those that were lost in this step. Without numbers, estimates stand beside
        the truth only if there is one other vehicle.
        """


class PlottingPlanner(Planner, Protocol):
    """Optional: a planner that reports its planned path."""

    def path(self) -> Path:
        """Return the planned path, at most 20 positions, without changing the planner's state."""


class SignallingPlanner(Planner, Protocol):
    """Optional: a planner that reports numbers, for the formulas of requirements.

    Attributes:
        signal_names: their names, such as `lost_tracks`; a formula has them as
            `planner.lost_tracks`.
    """

    signal_names: ClassVar[tuple[str, ...]]

    def signals(self) -> Mapping[str, float]:
        """Return the value of each signal after the reset or the last step, by name.

        It does not change the planner's state, and is called only if a campaign needs a signal.
        """


class TrackingPlanner(Planner, Protocol):
    """Optional: a planner that reports its losses of tracks.

    It numbers vehicles as it perceives them: under the channel `swapped`, a loss is booked under
    the perceived number, which may be another vehicle's.
    """

    def count_losses(self, vehicle: int) -> int:
        """Return how often it lost the track of a vehicle, by its number, since the reset."""


class PlannerPlugin(Protocol):
    """Makes planners; its `Settings` carry defaults, bounds and units."""

    Settings: ClassVar[type[msgspec.Struct]]

    def __call__(self, settings: Any) -> Planner:
        """Return a planner."""


class Situation(Protocol):
    """A scenario with its parameters: everything that a simulator needs to stage it.

    Attributes:
        mission: road and task, which the planner is given.
        steps: horizon of an episode.
        ego: initial state of the ego.
        actors: initial states of the other vehicles.
    """

    mission: Mission
    steps: int
    ego: VehicleState
    actors: tuple[VehicleState, ...]

    def move_actor(self, actor: int, step: int, ego: VehicleState) -> VehicleState:
        """Return the state of a scripted actor after `step` steps, given that of the ego."""


class TrafficModel(Protocol):
    """The other vehicles of one episode: they come, may react to the ego, and go."""

    def advance(self, step: int, ego: VehicleState) -> Mapping[int, VehicleState]:
        """Return the vehicles that are there after a step, by number from 1; never none.

        A number that has gone is not used again.

        Args:
            step: number of steps so far; the steps are asked for in order, from 1.
            ego: the ego after that step.
        """


@runtime_checkable
class ReactiveSituation(Protocol):
    """A situation whose vehicles depend on the course of the episode, or come and go.

    Attributes:
        mission: road and task, which the planner is given.
        steps: horizon of an episode.
        ego: initial state of the ego.
        actors: initial states of the vehicles that are there at the start, numbered from 1.
        challenges: name of the challenge that each vehicle of the episode is a part of, in the
            order of the numbers. A collision with it has this cause.
    """

    mission: Mission
    steps: int
    ego: VehicleState
    actors: tuple[VehicleState, ...]
    challenges: tuple[str, ...]

    def start_traffic(self) -> TrafficModel:
        """Return the traffic of a new episode, at its start."""


class Scenario(Protocol):
    """A named scenario; its `Parameters` carry defaults, bounds and units."""

    Parameters: ClassVar[type[msgspec.Struct]]

    def __call__(self, parameters: Any, seed: int) -> Situation | ReactiveSituation:
        """Return the situation for some parameters; its randomness depends on the seed alone."""


class Simulation(Protocol):
    """One planner in one scenario: disturbances in, observations out.

    Attributes:
        dt_s: duration of a step.
        steps: horizon of an episode.
    """

    dt_s: float
    steps: int

    def reset(self, seed: int) -> Observation:
        """Begin an episode, and return the observation of its start, step 0."""

    def step(self, disturbance: tuple[float, ...]) -> Observation:
        """Disturb what the planner perceives, by a value of each channel in its unit.

        An event lasts where its value is 1.

        Raises:
            EpisodeError: this episode cannot go on.
        """

    def close(self) -> None:
        """Release the resources of the simulation."""


class Simulator(Protocol):
    """Opens simulations.

    Attributes:
        channels: the channels that it can inject, in the terms of `values.channels.ALL_CHANNELS`;
            those of `AXES` at least, which campaigns have unless they name others.
        occludes: optional; True where it takes `occlusion`.
    """

    channels: ClassVar[frozenset[str]]

    def open(
        self, scenario: Scenario, parameters: Any, planner: Planner, channels: tuple[Channel, ...]
    ) -> Simulation:
        """Return a simulation of the planner in the scenario; it may be reset repeatedly.

        Args:
            scenario: what is staged.
            parameters: of the scenario.
            planner: drives the ego.
            channels: channels of each disturbance, in order, with their defaults filled in. Their
                names are some of `channels`, and `vehicle_1.speed` and so on where these have
                `every.speed`. Channels of the scenario's parameters are not among them.

        A simulator with `occludes` takes a further argument, `occlusion`: whether vehicles that
        others hide are not detected. It is given only if it is True.
        """


class EpisodeEngine(Protocol):
    """Runs episodes of one campaign, one after the other, in this process."""

    def add_policy(self, policy: Policy) -> None:
        """Store a policy version for the policy sources that name it."""

    def run(self, tasks: Sequence[EpisodeTask]) -> Iterator[EpisodeResult]:
        """Yield the results in the order of the tasks. Never raises for a fault of an episode."""

    def close(self) -> None:
        """Release the resources of the engine."""


@runtime_checkable
class LockstepEngine(EpisodeEngine, Protocol):
    """Optional: an engine that runs several episodes side by side."""

    @property
    def room(self) -> int:
        """Number of episodes that may begin now."""

    def begin(self, task: EpisodeTask) -> None:
        """Begin an episode for which there is room. Never raises for its faults."""

    def turn(self) -> list[EpisodeResult]:
        """Advance the episodes for a while; return the results of those that have ended."""


class Explainer(Protocol):
    """Runs one episode in this process to explain it."""

    def __call__(self, setup: EpisodeSetup, task: EpisodeTask) -> ExplainedEpisode:
        """Return the episode with the planner's own account of each step.

        Raises:
            UnknownName: a plug-in, setting or parameter does not exist.
            InvalidValue: a setting or parameter is outside its bounds.
        """
