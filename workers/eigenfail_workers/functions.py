"""Engine for campaigns on a function of a noise trajectory, without road, planner or simulator."""

import signal
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from importlib import import_module, invalidate_caches
from importlib.util import find_spec
from pathlib import Path
from time import perf_counter
from traceback import extract_tb, format_exception_only
from types import ModuleType

import numpy as np
from msgspec.structs import replace

from eigenfail import functions
from eigenfail.errors import EpisodeError, InputError, InvalidValue, SimulatorError, clean_text
from eigenfail.process_state import ProcessState
from eigenfail.settings import read_settings
from eigenfail.values.disturbance import AXES, DisturbanceModel, NoiseTrajectory
from eigenfail.values.episode import EpisodeResult, EpisodeSetup, EpisodeTask, Outcome, unrunnable
from eigenfail.values.learning import Policy
from eigenfail.values.measures import MAX_MAGNITUDE, Measures
from eigenfail.values.scene import Observation, VehicleState
from eigenfail_workers.faults import make_fault, make_state_change_error, wrap_errors
from eigenfail_workers.noise import sources
from eigenfail_workers.noise.deviations import to_float32
from eigenfail_workers.noise.policy import store_policy

NULL_VEHICLE = VehicleState(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
"""What an adversary observes of every vehicle, as a function has none."""

NUMERIC_KINDS = frozenset("iuf")
# A timer that is set to 0 is switched off. An outer one whose time is over must still fire.
MIN_TIMER_S = 1e-3
DECORATORS = "eigenfail.functions"
IMPORT_TIME_KEY = "__eigenfail_written_ns__"
"""Name in a module for the time at which its file had last been written when it was imported."""


class FunctionEngine:
    """Runs episodes; each episode is one call of a function. Implements `EpisodeEngine`.

    The function receives a_t = sigma · u_t, where sigma is the disturbance model's scale and u is
    z in the model's shape; with the default model it receives z. An adversary's policy chooses z
    step by step; it observes zeros, and the progress.

    Args:
        function: the function under test.
        steps: length of a noise trajectory.
        model: model of the disturbances; only its scale and its shape count.
        limit_s: wall time that one call may take.
        channels: number of channels of the noise.
    """

    def __init__(
        self,
        function: functions.FunctionUnderTest,
        steps: int,
        model: DisturbanceModel = DisturbanceModel(),  # noqa: B008 - it is frozen
        limit_s: float = functions.LIMIT_S,
        channels: int = len(AXES),
    ) -> None:
        self._function = function
        self._steps = steps
        self._shape = model.shape
        self._sigma = np.full((steps, channels), to_float32(model.scale), np.float32)
        self._limit_s = limit_s
        self._policies: dict[int, Policy] = {}
        self._process_state = ProcessState()

    def add_policy(self, policy: Policy) -> None:
        """Store a copy of a policy version; the oldest versions are dropped."""
        store_policy(self._policies, policy)

    def run(self, tasks: Sequence[EpisodeTask]) -> Iterator[EpisodeResult]:
        """Yield the results in the order of the tasks."""
        return map(self._run, tasks)

    def close(self) -> None:
        """Do nothing: the engine holds no resources."""

    def _run(self, task: EpisodeTask) -> EpisodeResult:
        began = perf_counter()
        try:
            # A function stands in for the simulator: its faults are of that kind.
            with wrap_errors(SimulatorError, "The noise", "Look into its source."):
                drawn = self._draw_noise(task)
            result = self._call_function(drawn)
        except (EpisodeError, InputError) as error:
            result = unrunnable(task, make_fault(error))
        if changes := self._process_state.changes():
            culprit = f"the function '{getattr(self._function, '__name__', 'under test')}'"
            changed = make_state_change_error(SimulatorError, culprit, changes, result)
            result = replace(
                result,
                outcome=Outcome.ERRORED,
                measures=None,
                states=None,
                fault=make_fault(changed),
            )
        return replace(result, wall_s=perf_counter() - began)

    def _draw_noise(self, task: EpisodeTask) -> EpisodeResult:
        """Return a result with the noise of the episode, before its outcome is known."""
        channels = self._sigma.shape[1]
        context = sources.NoiseContext(task.seed, self._steps, self._policies, channels)
        source = sources.begin(task.source, context)
        seen = (Observation(step, NULL_VEHICLE, (NULL_VEHICLE,)) for step in range(self._steps))
        z = np.array([source.draw(observation, NULL_VEHICLE) for observation in seen], np.float32)
        return EpisodeResult(
            index=task.index,
            seed=task.seed,
            outcome=Outcome.SAFE,
            steps=self._steps,
            noise=NoiseTrajectory(z, self._sigma, self._shape),
            source=task.source_kind,
            states=source.states(),
        )

    def _call_function(self, drawn: EpisodeResult) -> EpisodeResult:
        """Return the result with its outcome; if the function fails, the noise stays for replay."""
        try:
            noise = drawn.noise.injected.copy()  # the function may change it
            robustness = _compute_robustness(self._function, noise, self._limit_s)
        except SimulatorError as error:
            return replace(drawn, outcome=Outcome.ERRORED, states=None, fault=make_fault(error))
        outcome = Outcome.SAFE if robustness > 0.0 else Outcome.COLLISION
        return replace(drawn, outcome=outcome, measures=Measures(max(0.0, robustness)))


def make_function_engine(setup: EpisodeSetup) -> FunctionEngine:
    """Return the engine of a campaign on a function.

    Raises:
        UnknownName: a parameter does not exist.
        InvalidValue: a parameter is outside its bounds, or the function cannot be used.
    """
    given = read_settings(
        functions.FunctionParameters, setup.scenario_parameters, "scenario_parameters"
    )
    function = find_function(setup.planner)
    channels = len(given.channels)
    return FunctionEngine(function, given.steps, setup.disturbance, given.limit_s, channels)


def _compute_robustness(
    function: functions.FunctionUnderTest, noise: functions.Noise, limit_s: float
) -> float:
    """Return the answer of the function to noise of shape (steps, channels) [sigma].

    Raises:
        SimulatorError: the function raised, took too long, or did not return one finite number.
    """
    try:
        with _limit_time(limit_s):
            answer = np.asarray(function(noise.reshape(*function.leading, *noise.shape)))
    except _CallTimeout:
        remedy = "Make it faster, or raise `limit_s`."
        raise SimulatorError(f"The function took longer than {limit_s:g} s.", remedy) from None
    except (Exception, SystemExit) as error:
        frame = extract_tb(error.__traceback__)[-1]
        place = f"{Path(frame.filename).name}, line {frame.lineno}"
        problem = f"The function raised {_format_error(error)}."
        raise SimulatorError(problem, f"Look at {place}.") from error
    if answer.shape != function.leading or answer.dtype.kind not in NUMERIC_KINDS:
        raise SimulatorError(
            f"The function returned an array of shape {answer.shape} and type {answer.dtype}.",
            f"It must return real numbers of shape {function.leading}.",
        )
    robustness = float(answer.item())
    if not abs(robustness) <= MAX_MAGNITUDE:
        problem = f"The function returned {robustness:g}."
        remedy = f"Robustness must be a finite number from -{MAX_MAGNITUDE:g} to {MAX_MAGNITUDE:g}."
        raise SimulatorError(problem, remedy)
    return robustness


class _CallTimeout(BaseException):
    """Interrupts a call. Not an Exception, so that the call cannot catch it and go on."""


@contextmanager
def _limit_time(limit_s: float) -> Iterator[None]:
    """Interrupt the block after a wall time [s], by the timer of the process.

    Only Python code in the main thread can be interrupted. Compiled code and other threads are left
    alone: in a service the worker kills its child process instead.

    Raises:
        _CallTimeout: the block was interrupted.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    began_s = time.monotonic()
    handler = signal.signal(signal.SIGALRM, _interrupt)
    left_s, interval_s = signal.setitimer(signal.ITIMER_REAL, limit_s)
    try:
        yield
    finally:
        # The timer is stopped before the handler goes: by default an alarm ends the process.
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, handler)
        if left_s:  # a timer that was set outside goes on
            left_s -= time.monotonic() - began_s
            signal.setitimer(signal.ITIMER_REAL, max(left_s, MIN_TIMER_S), interval_s)


def _interrupt(*_: object) -> None:
    raise _CallTimeout


def find_function(place: str) -> functions.FunctionUnderTest:
    """Return the function at `module:function`.

    Only functions that their author has declared with `of_trajectory` or `of_batch` are called: a
    campaign comes from a request, and must not be able to call whatever can be imported.

    Raises:
        InvalidValue: the function is not allowed here, cannot be imported, does not exist, is not
            declared, or its file was changed after it was imported.
    """
    functions.refuse_unlisted(place)
    name, attribute = place.split(":")
    found = getattr(_import_module(name, place), attribute, None)
    if found is None:
        problem = f"module '{name}' has no '{attribute}'."
        raise InvalidValue("planner", problem, "Correct the name behind the colon.")
    if not isinstance(found, functions.FunctionUnderTest):
        remedy = "Put @of_trajectory or @of_batch of eigenfail.functions above it."
        raise InvalidValue("planner", f"'{place}' is not declared to be under test.", remedy)
    return found


def _import_module(name: str, place: str) -> ModuleType:
    functions.look_in_this_folder()
    invalidate_caches()
    try:
        _check_module(name, place)
        module = import_module(name)
    except InvalidValue:
        raise
    except (Exception, SystemExit) as error:
        raise functions.make_import_error(place, _format_error(error)) from error
    file = Path(getattr(module, "__file__", None) or "")
    written_ns = file.stat().st_mtime_ns if file.is_file() else 0
    # Modules are imported once a process, which would go on with the old text.
    if vars(module).setdefault(IMPORT_TIME_KEY, written_ns) != written_ns:
        problem = f"the file of '{name}' was changed after this worker imported it."
        raise InvalidValue("planner", problem, "Start the service again: it runs the old code.")
    return module


def _check_module(name: str, place: str) -> None:
    """Refuse a module whose text does not name the decorators: to import a module is to run it.

    Raises:
        InvalidValue: its text does not name them.
        ImportError: the module does not exist.
    """
    spec = find_spec(name)
    if spec is None:
        raise ModuleNotFoundError(f"No module named '{name}'")
    source = spec.origin if spec.has_location else None
    if source is None or DECORATORS not in Path(source).read_text("utf-8", "replace"):
        remedy = f"Import of_trajectory or of_batch from {DECORATORS} in it."
        raise InvalidValue("planner", f"'{place}' is in no module of functions.", remedy)


def _format_error(error: BaseException) -> str:
    """Return the last line of the traceback of an error, without a full stop."""
    said = format_exception_only(error)[-1].strip()
    return clean_text(said.splitlines()[-1].rstrip("."))
