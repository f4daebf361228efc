"""What runs an episode: planner, scenario, simulator, engine."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, ClassVar, Protocol, runtime_checkable

import msgspec

from eigenfail.values import (
    Control,
    EpisodeResult,
    EpisodeSetup,
    EpisodeTask,
    ExplainedEpisode,
    Mission,
    Observation,
    Path,
    Perception,
    Policy,
    VehicleState,
)


class Planner(Protocol):
    """The system under test: perceives, decides. Keeps no state over a reset."""

    def reset(self, mission: Mission) -> None:
        """Forget everything: a new episode begins."""

    def act(self, perception: Perception) -> Control:
        """Decide on one step. Called every `dt_s` of the scenario, in order."""


class ExplainingPlanner(Planner, Protocol):
    """A planner that can say why it did what it did. No planner has to."""

    def explain(self) -> Mapping[str, str | float]:
        """An account of the last step, in plain names and values; it changes nothing.

        Names are free, units in them. `eigenfail episode explain` understands these, if given:
        `mode`, `candidate`, `rule`, `override` ("none" if there was none) and `qp_status` ("solved"
        if there was nothing wrong) in words; `heeds`, what it takes the vehicle ahead for
        ("nobody" if it heeds none), with `gap_m` and `closing_mps` as it believes them; `tracks`,
        the states of all it tracks; `lost_tracks`, how many it lost since the reset.
        """


class PlottingPlanner(Planner, Protocol):
    """A planner that can say where it means to drive. No planner has to."""

    def path(self) -> Path:
        """Where it means to drive after the last step, at most 20 positions; it changes nothing."""


class PlannerPlugin(Protocol):
    """Makes planners; its `Settings` carry defaults, bounds and units."""

    Settings: ClassVar[type[msgspec.Struct]]

    def __call__(self, settings: Any) -> Planner:
        """A planner."""


class Situation(Protocol):
    """A scenario with its parameters filled in: everything a simulator needs to stage it.

    Attributes:
        mission: the road, and what the planner is told.
        steps: horizon of an episode.
        ego: where the ego starts.
        actors: where the others start.
    """

    mission: Mission
    steps: int
    ego: VehicleState
    actors: tuple[VehicleState, ...]

    def move_actor(self, actor: int, step: int, ego: VehicleState) -> VehicleState:
        """Where a scripted actor is after `step` steps, given where the ego is then."""


class Scenario(Protocol):
    """A named scenario; its `Parameters` carry defaults, bounds and units."""

    Parameters: ClassVar[type[msgspec.Struct]]

    def __call__(self, parameters: Any, seed: int) -> Situation:
        """The situation for these parameters; what is random in it comes from the seed."""


class Simulation(Protocol):
    """One stack in one scenario, seen from outside: disturbances in, observations out."""

    dt_s: float
    steps: int

    def reset(self, seed: int) -> Observation:
        """Begin an episode; the observation of its start, step 0."""

    def step(self, disturbance: tuple[float, float]) -> Observation:
        """Disturb the perceived position of the nearest vehicle by (longitudinal, lateral) [m].

        Raises:
            EpisodeError: this episode cannot go on.
        """

    def close(self) -> None:
        """Let go of whatever the simulation holds."""


class Simulator(Protocol):
    """Opens simulations."""

    def open(self, scenario: Scenario, parameters: Any, planner: Planner) -> Simulation:
        """A simulation of the planner in the scenario; it may be reset any number of times."""


class EpisodeEngine(Protocol):
    """Runs episodes of one campaign, one after the other, in this process."""

    def learn(self, policy: Policy) -> None:
        """Keep a policy version for the policy sources that name it."""

    def run(self, tasks: Sequence[EpisodeTask]) -> Iterator[EpisodeResult]:
        """The results, in the order of the tasks. Never raises for an episode's own troubles."""

    def close(self) -> None:
        """Let go of the simulation."""


@runtime_checkable
class LockstepEngine(EpisodeEngine, Protocol):
    """An engine that runs several episodes side by side. No engine has to."""

    @property
    def room(self) -> int:
        """How many more episodes may begin now."""

    def begin(self, task: EpisodeTask) -> None:
        """Begin an episode, for which there is room. Never raises for its troubles."""

    def turn(self) -> list[EpisodeResult]:
        """Go on with all of them for a while; the results of those that are over, in any order."""


class Explainer(Protocol):
    """Runs one episode for the sake of its explanation, in this process."""

    def __call__(self, setup: EpisodeSetup, task: EpisodeTask) -> ExplainedEpisode:
        """The episode with the planner's own account of each step.

        Raises:
            UnknownName: a plug-in, setting or parameter that does not exist.
            InvalidValue: a setting or parameter outside its bounds.
        """
