"""Planners' accounts of their decisions, step by step: explanations and signals."""

from collections.abc import Callable, Collection, Mapping, Sequence
from typing import NamedTuple

from msgspec.structs import replace

from eigenfail.contracts import Planner, Simulation
from eigenfail.errors import PlannerError, read_text
from eigenfail.values.proof import Account, Path
from eigenfail.values.scene import Control, Mission, Observation, Perception
from eigenfail.values.shapes import Row
from eigenfail.values.signals import PLANNER, is_signal_value
from eigenfail_workers.closed_loop import validate_control
from eigenfail_workers.faults import wrap_errors

MAX_POINTS = 20
"""Most points that are kept of a path, evenly chosen."""


class RecordedStep(NamedTuple):
    """The planner's decision in a step, and its explanation."""

    time_s: float
    control: Control
    account: Account
    path: Path


def read_account(given: Mapping[str, object]) -> Account:
    """Return an account with texts and floats alone."""
    return {
        read_text(name): float(value) if isinstance(value, (int, float)) else read_text(value)
        for name, value in given.items()
    }


def thin_path(path: Sequence[tuple[float, float]]) -> Path:
    """Return at most MAX_POINTS points of a path, its ends included."""
    last = len(path) - 1
    kept: Sequence[int] = range(last + 1)
    if last >= MAX_POINTS:
        # Whole numbers, so that the last point is exactly the last one.
        kept = [place * last // (MAX_POINTS - 1) for place in range(MAX_POINTS)]
    return tuple((float(path[place][0]), float(path[place][1])) for place in kept)


class RecordingPlanner:
    """Drives as its planner does, and records the explanation of each step. Implements `Planner`.

    Args:
        planner: any planner; those with `explain` or `path` are asked for them.
        steps: list that is filled with the steps of the last episode.
    """

    def __init__(self, planner: Planner, steps: list[RecordedStep]) -> None:
        self._planner = planner
        self._explain: Callable[[], Mapping[str, str | float]]
        self._explain = getattr(planner, "explain", dict)
        self._path: Callable[[], Sequence[tuple[float, float]]]
        self._path = getattr(planner, "path", tuple)
        self._steps = steps
        self.count_losses: Callable[[int], int] | None = getattr(planner, "count_losses", None)

    def reset(self, mission: Mission) -> None:
        """Begin a new episode."""
        self._steps.clear()
        self._planner.reset(mission)

    def act(self, perception: Perception) -> Control:
        """Return the planner's control, after recording its explanation."""
        # `explain` speaks of the last decision: `act` must come first.
        control = validate_control(self._planner.act(perception))
        with wrap_errors(PlannerError, "The planner's account", "Look into its `explain`."):
            account = read_account(self._explain())
        with wrap_errors(PlannerError, "The planner's path", "Look into its `path`."):
            path = thin_path(self._path())
        self._steps.append(RecordedStep(perception.time_s, control, account, path))
        return control


class SignallingSimulation:
    """Adds the signals of a planner to the observations of its simulation.

    Implements `Simulation`.

    Args:
        simulation: simulation that the planner drives in.
        planner: planner that drives there.
        names: names of the signals that are needed, as the planner has them.
    """

    def __init__(self, simulation: Simulation, planner: object, names: Collection[str]) -> None:
        self._simulation = simulation
        self._names = names
        self._signals: Callable[[], Mapping[str, object]] = getattr(planner, "signals", dict)
        self.dt_s = simulation.dt_s
        self.steps = simulation.steps
        self.close = simulation.close

    def reset(self, seed: int) -> Observation:
        """Begin an episode; see `Simulation.reset`."""
        return self._add_signals(self._simulation.reset(seed))

    def step(self, disturbance: Row) -> Observation:
        """Disturb and step; see `Simulation.step`."""
        return self._add_signals(self._simulation.step(disturbance))

    def _add_signals(self, now: Observation) -> Observation:
        with wrap_errors(PlannerError, "The planner's signals", "Look into its `signals`."):
            reported = self._signals()
            values = {name: read_signal(name, reported.get(name)) for name in self._names}
        named = {f"{PLANNER}.{name}": value for name, value in values.items()}
        return replace(now, signals={**(now.signals or {}), **named})


def read_signal(name: str, value: object) -> float:
    """Return the value of a planner's signal.

    Raises:
        PlannerError: the value is not a finite number.
    """
    if not is_signal_value(value):
        problem = f"The planner reports {read_text(value)} as its signal '{name}'."
        raise PlannerError(problem, "`signals` must return a finite number for each name.")
    return float(value)
