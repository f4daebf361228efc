"""Runs the episodes of a campaign in this process."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from functools import cached_property
from time import perf_counter
from typing import Any

from msgspec import structs

from eigenfail import plugins
from eigenfail.contracts import Planner, Simulation
from eigenfail.errors import (
    EpisodeError,
    InputError,
    InvalidValue,
    PlannerError,
    SimulatorError,
)
from eigenfail.settings import read_settings
from eigenfail.values import EpisodeResult, EpisodeSetup, EpisodeTask, Policy
from eigenfail.values.variation import read_variation
from eigenfail_workers.episode import completed, failed, run_episode
from eigenfail_workers.faults import blamed_on, fault
from eigenfail_workers.measures.recorder import Recorder
from eigenfail_workers.noise import sources
from eigenfail_workers.noise.policy import keep


def unwatched(planner: Planner) -> Planner:
    """Nobody looks on."""
    return planner


class Engine:
    """Implements `EpisodeEngine`: one simulation, reset for each episode.

    It is opened anew after a fault, and where an episode's own scenario parameters are others.

    Args:
        setup: what all episodes share.
        watch: stands in for each planner that is made, to look on while it drives.

    Raises:
        UnknownName: a plug-in, setting or parameter that does not exist.
        InvalidValue: a setting or parameter outside its bounds.
    """

    def __init__(
        self, setup: EpisodeSetup, watch: Callable[[Planner], Planner] = unwatched
    ) -> None:
        self._setup = setup
        self._watch = watch
        self._simulator = plugins.load(plugins.SIMULATORS, setup.simulator)()
        scenario = plugins.load(plugins.SCENARIOS, setup.scenario)
        self._variation = read_variation(scenario.Parameters, setup.scenario_parameters)
        self._parameters: Any = None
        self._scenario = scenario()
        self._planner_class = plugins.load(plugins.PLANNERS, setup.planner)
        self._planner_settings = read_settings(
            self._planner_class.Settings, setup.planner_settings, "planner_settings"
        )
        self._policies: dict[int, Policy] = {}
        self._simulation: Simulation | None = None

    def learn(self, policy: Policy) -> None:
        """Keep a policy version, as it is now; the oldest make room."""
        keep(self._policies, policy)

    def run(self, tasks: Sequence[EpisodeTask]) -> Iterator[EpisodeResult]:
        """The results, in the order of the tasks."""
        return map(self._run, tasks)

    def _run(self, task: EpisodeTask) -> EpisodeResult:
        began = perf_counter()
        recorder = Recorder(self._setup.disturbance.shape)
        try:
            result = self._complete(task, recorder)
        except (EpisodeError, InputError) as error:
            self._start_clean()
            result = failed(task, recorder, fault(error))
        return structs.replace(result, wall_s=perf_counter() - began)

    def _complete(self, task: EpisodeTask, recorder: Recorder) -> EpisodeResult:
        with blamed_on(SimulatorError, "The episode", "Look into simulator and scenario."):
            simulation = self._opened(self._variation.draw(task.seed))
            given = sources.Circumstances(task.seed, simulation.steps, self._policies)
            noise = sources.begin(task.source, given)
            run_episode(simulation, task.seed, self._setup.disturbance, noise, recorder)
            return completed(self._setup, task, noise, recorder, simulation.dt_s)

    def _opened(self, parameters: Any) -> Simulation:
        """The simulation for these parameters, opened with a fresh planner if there is none."""
        if parameters != self._parameters:
            self._start_clean()
        if self._simulation is None:
            planner = self._new_planner()
            self._simulation = self._simulator.open(self._scenario, parameters, planner)
            self._parameters = parameters
        if self._variation.varied and self._simulation.steps > self._horizon:
            raise InvalidValue(
                "scenario_parameters",
                f"{parameters} makes an episode of {self._simulation.steps} steps, which is longer "
                f"than any at the ends of the distributions: {self._horizon}.",
                "Vary less: what learns is made for episodes no longer than those.",
            )
        return self._simulation

    @cached_property
    def _horizon(self) -> int:
        return self._variation.largest(lambda parameters: self._scenario(parameters, 0).steps)

    def _new_planner(self) -> Planner:
        with blamed_on(PlannerError, "Making the planner", "Look into the planner."):
            return self._watch(self._planner_class(self._planner_settings))

    def _start_clean(self) -> None:
        """Close what there is; what broke may break once more then, and that is no news."""
        with suppress(Exception):
            self.close()

    def close(self) -> None:
        """Let go of the simulation and its planner."""
        simulation, self._simulation = self._simulation, None
        if simulation is not None:
            simulation.close()
