"""Contracts of the parts that run an episode: planner, scenario, simulator and engine."""

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
    """The system under test. A reset clears all of its state."""

    def reset(self, mission: Mission) -> None:
        """Forget everything, and begin a new episode."""

    def act(self, perception: Perception) -> Control:
        """Return the control of one step. Called every `dt_s` of the scenario, in order."""


class ExplainingPlanner(Planner, Protocol):
    """Optional: a planner that explains its decisions."""

    def explain(self) -> Mapping[str, str | float]:
        """Return an account of the last step in plain names and values, without changing state.

        Names are free; they include units. `eigenfail episode explain` understands these names:

        - `mode`, `candidate`, `rule`: words.
        - `override`: words, "none" without an override.
        - `qp_status`: words, "solved" without a problem.
        - `heeds`: role of the vehicle that the planner takes into account, or "nobody".
        - `gap_m`, `closing_mps`: the planner's estimates for that vehicle.
        - `vehicle`: number of that vehicle in `Perception.ids`. Without it, estimates are compared
          with the truth only if there is a single other vehicle.
        - `tracks`: states of all tracks.
        - `lost_tracks`: number of lost tracks since the reset.
        - `lost_vehicles`: numbers of the vehicles that were lost in this step, as text.
        """


class PlottingPlanner(Planner, Protocol):
    """Optional: a planner that reports its planned path."""

    def path(self) -> Path:
        """Return the planned path, at most 20 positions, without changing the planner's state."""


class SignallingPlanner(Planner, Protocol):
    """Optional: a planner that reports numbers, for the formulas of requirements.

    Attributes:
        signal_names: their names, such as `lost_tracks`; in a formula, `planner.lost_tracks`.
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
    """Maker of planners; its `Settings` carry defaults, bounds and units."""

    Settings: ClassVar[type[msgspec.Struct]]

    def __call__(self, settings: Any) -> Planner:
        """Return a planner."""


class Situation(Protocol):
    """A scenario with its parameters: everything that a simulator needs to stage it.

    Attributes:
        mission: road and task for the planner.
        steps: horizon of an episode.
        ego: initial state of the ego.
        actors: initial states of all vehicles except the ego.
    """

    mission: Mission
    steps: int
    ego: VehicleState
    actors: tuple[VehicleState, ...]

    def move_actor(self, actor: int, step: int, ego: VehicleState) -> VehicleState:
        """Return the state of a scripted actor after `step` steps, given the ego's state."""


class TrafficModel(Protocol):
    """Traffic of one episode: vehicles that come, may react to the ego, and go."""

    def advance(self, step: int, ego: VehicleState) -> Mapping[int, VehicleState]:
        """Return the vehicles that are present after a step, by number from 1; at least one.

        The number of a vehicle that has gone is not used again.

        Args:
            step: number of steps so far; calls are in order of the steps, from 1.
            ego: the ego after that step.
        """


@runtime_checkable
class ReactiveSituation(Protocol):
    """A situation whose vehicles depend on the course of the episode, or come and go.

    Attributes:
        mission: road and task for the planner.
        steps: horizon of an episode.
        ego: initial state of the ego.
        actors: initial states of the vehicles that are present at the start, numbered from 1.
        challenges: name of the challenge that each vehicle of the episode belongs to, in the order
            of the numbers. It is the cause of a collision with that vehicle.
    """

    mission: Mission
    steps: int
    ego: VehicleState
    actors: tuple[VehicleState, ...]
    challenges: tuple[str, ...]

    def start_traffic(self) -> TrafficModel:
        """Return the traffic at the start of a new episode."""


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
        """Begin an episode, and return the observation of step 0."""

    def step(self, disturbance: tuple[float, ...]) -> Observation:
        """Run one step with the planner's perception disturbed by one value of each channel.

        Each value has the unit of its channel. An event is active if its value is 1.

        Raises:
            EpisodeError: this episode cannot continue.
        """

    def close(self) -> None:
        """Release the resources of the simulation."""


class Simulator(Protocol):
    """Opener of simulations.

    Attributes:
        channels: the channels that it can inject, named as in `values.channels.ALL_CHANNELS`. They
            include `AXES`, the default channels of campaigns.
        occludes: optional; True if `open` takes `occlusion`.
    """

    channels: ClassVar[frozenset[str]]

    def open(
        self, scenario: Scenario, parameters: Any, planner: Planner, channels: tuple[Channel, ...]
    ) -> Simulation:
        """Return a simulation of the planner in the scenario; it may be reset repeatedly.

        Args:
            scenario: the scenario to stage.
            parameters: parameters of the scenario.
            planner: drives the ego.
            channels: channels of each disturbance, in order, with their defaults filled in. Their
                names are some of the class's `channels`, with `vehicle_1.speed` and so on for
                `every.speed`. Channels of the scenario's parameters are not included.

        A simulator with `occludes` takes a further argument, `occlusion`: whether vehicles that are
        hidden by others stay undetected. It is passed only if it is True.
        """


class EpisodeEngine(Protocol):
    """Runner of a campaign's episodes, one after another, in this process."""

    def add_policy(self, policy: Policy) -> None:
        """Store a policy version for the policy sources that refer to it."""

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
        """Advance the episodes for a while; return the results of episodes that have ended."""


class Explainer(Protocol):
    """Runner of one episode in this process to explain it."""

    def __call__(self, setup: EpisodeSetup, task: EpisodeTask) -> ExplainedEpisode:
        """Return the episode with the planner's own account of each step.

        Raises:
            UnknownName: a plug-in, setting or parameter does not exist.
            InvalidValue: a setting or parameter is outside its bounds.
        """
