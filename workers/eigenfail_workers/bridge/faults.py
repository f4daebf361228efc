"""Whose fault it was, as a bridge has it, in the errors that the engine knows."""

from collections.abc import Callable

from eigenfail.errors import (
    EpisodeError,
    InputError,
    InvalidValue,
    PlannerError,
    SimulatorError,
    SolverError,
)
from eigenfail_workers.bridge.messages import Fault, in_words


def of_campaign(message: str) -> InvalidValue:
    """The campaign asks for what cannot be done."""
    return InvalidValue("bridge", message)


ERRORS: dict[Fault, Callable[[str], EpisodeError | InputError]] = {
    "simulator": SimulatorError,
    "planner": PlannerError,
    "solver": SolverError,
    "input": of_campaign,
}


def error_of(fault: Fault, message: str) -> EpisodeError | InputError:
    """The error that a fault stands for."""
    return ERRORS[fault](in_words(message) or f"The bridge blames the {fault} without a word.")
