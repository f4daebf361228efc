"""One episode of a campaign in a slot of a bridge: its requests, observations and result."""

from collections.abc import Mapping
from time import perf_counter

import msgspec
from msgspec.structs import replace

from eigenfail.bridges import Plain, foreign
from eigenfail.errors import EpisodeError, InputError, InvalidValue, SimulatorError, UnknownName
from eigenfail.values import (
    Control,
    EpisodeResult,
    EpisodeSetup,
    EpisodeTask,
    Observation,
    Policy,
    VehicleState,
)
from eigenfail_workers.bridge.connection import Connection
from eigenfail_workers.bridge.messages import (
    BridgeScenario,
    BridgeWelcome,
    Pair,
    SlotObservation,
    SlotStart,
    SlotStep,
    make_error,
)
from eigenfail_workers.episode import EpisodeDriver, make_errored_result, make_result
from eigenfail_workers.faults import make_fault, wrap_errors
from eigenfail_workers.measures.geometry import find_nearest
from eigenfail_workers.measures.recorder import Recorder
from eigenfail_workers.noise import sources


class BridgeEpisode:
    """An episode from its request to its result.

    Args:
        setup: setup of the campaign.
        task: task of the episode.
        parameters: parameters of its scenario, with `steps` and `dt_s`.
        settings: settings of the planner.
        policies: policies by version, for a task that names one.

    Attributes:
        task: task of the episode.
        dt_s: duration of a step according to the campaign. [s]
    """

    def __init__(
        self,
        setup: EpisodeSetup,
        task: EpisodeTask,
        parameters: msgspec.Struct,
        settings: dict[str, Plain],
        policies: Mapping[int, Policy],
    ) -> None:
        self.task = task
        self._setup = setup
        self._settings = settings
        self._foreign = foreign(parameters)
        named = msgspec.structs.asdict(parameters)
        self._steps, self.dt_s = int(named["steps"]), float(named["dt_s"])
        self._wall_s, self._measured_s = 0.0, perf_counter()
        self._recorder = Recorder(setup.disturbance, task.importance, setup.make_judge())
        context = sources.NoiseContext(task.seed, self._steps, policies)
        self._noise = sources.begin(task.source, context)
        self._driver = EpisodeDriver(setup.disturbance, self._noise, self._recorder, self._steps)
        self._last: Observation | None = None
        self._disturbance: Pair = (0.0, 0.0)

    @property
    def has_begun(self) -> bool:
        """Whether the bridge has reported the start of the episode."""
        return self._last is not None

    def make_start(self, slot: int) -> SlotStart:
        """Return what a reset asks for in a slot."""
        setup = self._setup
        return SlotStart(
            slot,
            self.task.seed,
            setup.scenario,
            self._foreign,
            setup.planner,
            self._settings,
            self._steps,
        )

    def make_step(self, slot: int) -> SlotStep:
        """Return what the next step asks for in a slot."""
        return SlotStep(slot, self._disturbance)

    def advance(
        self, seen: SlotObservation, beside: int, connection: Connection
    ) -> EpisodeResult | None:
        """Take in an observation, and return the result if the episode is over.

        Args:
            seen: answer to the last request.
            beside: number of episodes that share the time of the bridge, this one included.
            connection: connection to the bridge.
        """
        try:
            with wrap_errors(SimulatorError, "The episode", "Look into the bridge."):
                return self._advance(seen, beside, connection)
        except (EpisodeError, InputError) as error:
            return self.fail(error, beside)

    def _advance(
        self, seen: SlotObservation, beside: int, connection: Connection
    ) -> EpisodeResult | None:
        before, wall_s = self._last, self._measure_wall_s(beside)
        if before is None:
            now = read_start(seen)
        else:
            now = read_step(seen, before, self._disturbance, self.dt_s)
        self._last = now
        disturbance = self._driver.disturb(now)
        if disturbance is None:
            done = make_result(self._setup, self.task, self._noise, self._recorder, self.dt_s)
            return replace(done, wall_s=wall_s)
        self._disturbance = disturbance[0], disturbance[1]
        if wall_s > connection.timeouts.episode_s:
            raise connection.make_timeout()
        return None

    def fail(self, error: EpisodeError | InputError, beside: int) -> EpisodeResult:
        """Return the result of an episode that an error has ended."""
        failed = make_errored_result(self.task, self._recorder, make_fault(error))
        return replace(failed, wall_s=self._measure_wall_s(beside))

    def _measure_wall_s(self, beside: int) -> float:
        """Share of this episode in the wall time, divided among open episodes. [s]"""
        now_s = perf_counter()
        self._wall_s += (now_s - self._measured_s) / beside
        self._measured_s = now_s
        return self._wall_s


def read_start(seen: SlotObservation) -> Observation:
    """Return the start of an episode.

    Raises:
        EpisodeError: the episode did not begin.
        InvalidValue: the bridge cannot do what the campaign asks for.
    """
    ego = _read_ego(seen, 0)
    return Observation(
        0,
        ego,
        _read_others(seen),
        bool(seen.collided),
        bool(seen.ended),
        off_road=bool(seen.off_road),
    )


def read_step(
    seen: SlotObservation, before: Observation, disturbance: Pair, dt_s: float
) -> Observation:
    """Return the true state after a step, with the planner's control.

    Where the bridge does not report the perceived position, it is the requested one; where it does
    not report the control, it follows from the change of speed over `dt_s`, without steering.

    Raises:
        EpisodeError: the episode cannot go on.
        InvalidValue: the bridge cannot do what the campaign asks for.
    """
    ego = _read_ego(seen, before.step + 1)
    if len(seen.others) != len(before.others):
        problem = f"There were {len(before.others)} other vehicles, and now {len(seen.others)}."
        raise SimulatorError(problem, "A bridge shows all of them in every observation.")
    control = seen.control or ((ego.speed_mps - before.ego.speed_mps) / dt_s, 0.0)
    return Observation(
        before.step + 1,
        ego,
        _read_others(seen),
        bool(seen.collided),
        bool(seen.ended),
        seen.perceived or disturb_position(before, disturbance),
        Control(*control),
        Control(*seen.applied) if seen.applied else None,
        bool(seen.off_road),
    )


def _read_ego(seen: SlotObservation, step: int) -> VehicleState:
    """Return the ego of an observation, which must be that of the given step."""
    if seen.fault is not None:
        raise make_error(seen.fault, seen.message)
    if seen.ego is None or not seen.others:
        missing = "no ego" if seen.ego is None else "no other vehicles"
        problem = f"The bridge's observation has {missing}."
        raise SimulatorError(problem, "docs/bridge.md says what an observation holds.")
    if seen.step != step:
        problem = f"The bridge shows step {seen.step} where step {step} is due."
        raise SimulatorError(problem, "It counts the steps since the reset, from 0.")
    return VehicleState(*seen.ego)


def _read_others(seen: SlotObservation) -> tuple[VehicleState, ...]:
    return tuple([VehicleState(*vehicle) for vehicle in seen.others])


def disturb_position(before: Observation, disturbance: Pair) -> Pair:
    """Return the position at which the planner must perceive the nearest vehicle. [m]"""
    actor = before.others[find_nearest(before.ego, before.others)]
    return actor.x_m + disturbance[0], actor.y_m + disturbance[1]


def find_scenario(welcome: BridgeWelcome, name: str) -> BridgeScenario:
    """Return the scenario of a bridge by its name.

    Raises:
        UnknownName: the bridge does not offer that scenario.
    """
    for scenario in welcome.scenarios:
        if scenario.name == name:
            return scenario
    raise UnknownName("scenario", name, (each.name for each in welcome.scenarios))


def check_start(welcome: BridgeWelcome, start: SlotStart, dt_s: float) -> None:
    """Check that a bridge offers what an episode needs.

    Args:
        welcome: what the bridge offers.
        start: what the episode needs.
        dt_s: duration of a step according to the campaign.

    Raises:
        UnknownName: the bridge does not know the scenario, the planner, a parameter or a setting.
        InvalidValue: the scenario has fewer steps, or steps of another duration.
    """
    scenario = find_scenario(welcome, start.scenario)
    planners = {each.name: each.settings or {} for each in welcome.planners}
    if start.planner not in planners:
        raise UnknownName("planner", start.planner, planners)
    for field, given, known in (
        ("scenario_parameters", start.parameters, scenario.parameters or {}),
        ("planner_settings", start.settings, planners[start.planner]),
    ):
        for name in given:
            if name not in known:
                raise UnknownName(field, name, known)
    if start.steps > scenario.steps:
        problem = f"'{scenario.name}' has no more than {scenario.steps} steps."
        raise InvalidValue("scenario_parameters.steps", problem, "Ask for no more.")
    if dt_s != scenario.dt_s:
        problem = f"a step of '{scenario.name}' takes {scenario.dt_s:g} s, and not {dt_s:g} s."
        remedy = f"Write dt_s = {scenario.dt_s:g}."
        raise InvalidValue("scenario_parameters.dt_s", problem, remedy)
