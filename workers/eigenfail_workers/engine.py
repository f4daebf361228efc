"""Engine that runs the episodes of a campaign with simulator and planner in this process."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from functools import cached_property
from time import perf_counter
from typing import Any

from msgspec import structs

from eigenfail import errors, plugins
from eigenfail.contracts import Planner, Simulation
from eigenfail.process_state import ProcessState
from eigenfail.settings import read_settings
from eigenfail.values.episode import EpisodeResult, EpisodeSetup, EpisodeTask
from eigenfail.values.learning import Policy
from eigenfail.values.signals import PLANNER
from eigenfail.values.variation import read_variation
from eigenfail.worlds import resolve_disturbance
from eigenfail_workers.accounts import SignallingSimulation
from eigenfail_workers.episode import make_errored_result, make_result, run_episode
from eigenfail_workers.faults import make_fault, make_state_change_error, wrap_errors
from eigenfail_workers.measures.recorder import Recorder
from eigenfail_workers.noise.campaign_noise import CampaignNoise
from eigenfail_workers.noise.sources import NoiseSource


class Engine:
    """Runs episodes in one simulation, reset for each episode. Implements `EpisodeEngine`.

    The simulation is reopened after a fault, and when the scenario parameters change.

    Args:
        setup: setup of the campaign.
        wrap_planner: returns what drives in place of each new planner; default: the planner.

    Raises:
        UnknownName: a plug-in, setting or parameter does not exist.
        InvalidValue: a setting or parameter is outside its bounds.
    """

    def __init__(
        self, setup: EpisodeSetup, wrap_planner: Callable[[Planner], Planner] | None = None
    ) -> None:
        self._setup = setup
        self._wrap_planner = wrap_planner
        self._simulator = plugins.load(plugins.SIMULATORS, setup.simulator)()
        scenario = plugins.load(plugins.SCENARIOS, setup.scenario)
        self._parameters: Any = None
        self._scenario = scenario()
        self._planner_class = plugins.load(plugins.PLANNERS, setup.planner)
        self._planner_settings = read_settings(
            self._planner_class.Settings, setup.planner_settings, "planner_settings"
        )
        self._model = resolve_disturbance(setup)
        self._noise = CampaignNoise(self._model)
        self._variation = read_variation(
            scenario.Parameters,
            setup.scenario_parameters,
            searched=self._noise.searched,
            correlations=self._model.parameter_correlations,
        )
        self._simulation: Simulation | None = None
        self._planner: Planner | None = None
        judge = setup.make_judge()
        # Sorted: the order of a set of texts differs from process to process.
        self._planner_signals = sorted(
            [
                name.removeprefix(f"{PLANNER}.")
                for name in (judge.signals if judge else ())
                if name.startswith(f"{PLANNER}.")
            ]
        )
        # Taken after the imports: what they change is the same for each episode in each process.
        self._process_state = ProcessState()

    def add_policy(self, policy: Policy) -> None:
        """Store a copy of a policy version; the oldest versions are dropped."""
        self._noise.add_policy(policy)

    def run(self, tasks: Sequence[EpisodeTask]) -> Iterator[EpisodeResult]:
        """Yield the results in the order of the tasks."""
        return map(self._run, tasks)

    def _run(self, task: EpisodeTask) -> EpisodeResult:
        began = perf_counter()
        recorder = Recorder(self._model, task.importance, self._setup.make_judge())
        try:
            result = self._run_to_end(task, recorder)
        except (errors.EpisodeError, errors.InputError) as error:
            self._discard()
            result = make_errored_result(task, recorder, make_fault(error))
        if changes := self._process_state.changes():
            result = make_errored_result(
                task, recorder, make_fault(self._make_state_change_error(changes, result))
            )
        return structs.replace(result, wall_s=perf_counter() - began)

    def _make_state_change_error(
        self, changes: list[str], result: EpisodeResult
    ) -> errors.EpisodeError:
        """Return the error of an episode that has changed process-wide state.

        The responsible plug-in is unknown: all plug-ins that are not built in are named. Episodes
        of an engine run one at a time, so this episode changed the state.
        """
        setup = self._setup
        used = {
            plugins.PLANNERS: ("planner", setup.planner),
            plugins.SIMULATORS: ("simulator", setup.simulator),
            plugins.SCENARIOS: ("scenario", setup.scenario),
        }
        foreign = [used[group] for group in used if not plugins.is_built_in(group, used[group][1])]
        suspects = dict(foreign) or {"planner": setup.planner}
        kind = errors.PlannerError if "planner" in suspects else errors.SimulatorError
        named = " or ".join(f"the {part} '{name}'" for part, name in suspects.items())
        return make_state_change_error(kind, named, changes, result)

    def _run_to_end(self, task: EpisodeTask, recorder: Recorder) -> EpisodeResult:
        # Inner blocks have told the planner's errors apart: whatever has no kind yet is blamed on
        # the simulator.
        with wrap_errors(errors.SimulatorError, "The episode", "Look into simulator and scenario."):
            noise, simulation = self._begin(task)
            driven = simulation
            if self._planner_signals:
                driven = SignallingSimulation(simulation, self._planner, self._planner_signals)
            run_episode(driven, task.seed, self._model, noise, recorder)
            return make_result(self._setup, task, noise, recorder, simulation.dt_s)

    def _begin(self, task: EpisodeTask) -> tuple[NoiseSource, Simulation]:
        """Return the noise of an episode, and the simulation for its parameters.

        If noise chooses parameters, it is needed first.
        """
        noise = self._noise
        z = noise.choose(task, self._horizon) if noise.searched else {}
        simulation = self._open(self._variation.draw(task.seed, z))
        return noise.begin(task, simulation.steps), simulation

    def _open(self, parameters: Any) -> Simulation:
        """Return the simulation for these parameters, opened with a new planner if necessary."""
        # The same parameters reuse the simulation: opening one may take longer than an episode.
        if parameters != self._parameters:
            self._discard()
        if self._simulation is None:
            planner = self._new_planner()
            # Simulators without occlusion do not have this argument.
            occlusion = {"occlusion": True} if self._model.is_occluding else {}
            self._simulation = self._simulator.open(
                self._scenario, parameters, planner, self._noise.perceived, **occlusion
            )
            self._parameters = parameters
        varies = self._variation.varied or self._variation.searched
        if varies and self._simulation.steps > self._horizon:
            raise errors.InvalidValue(
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
        with wrap_errors(errors.PlannerError, "Making the planner", "Look into the planner."):
            planner: Planner = self._planner_class(self._planner_settings)
            self._planner = planner
            return self._wrap_planner(planner) if self._wrap_planner else planner

    def _discard(self) -> None:
        """Close the simulation after a fault."""
        # A broken simulator may fail again, which adds nothing.
        with (
            suppress(errors.EpisodeError, errors.InputError),
            wrap_errors(errors.SimulatorError, "Closing", "Look into `close`."),
        ):
            self.close()

    def close(self) -> None:
        """Close the simulation with its planner."""
        simulation, self._simulation = self._simulation, None
        if simulation is not None:
            simulation.close()
