"""One call of a function under test, and what its answer is worth."""

from math import isfinite

import numpy as np

from eigenfail.errors import SimulatorError
from eigenfail.functions import FunctionUnderTest, Noise
from eigenfail_workers.functions.telling import last_line, where
from eigenfail_workers.functions.time_limit import TookTooLong, at_most

NUMBERS = frozenset("iuf")


def robustness_of(function: FunctionUnderTest, noise: Noise, limit_s: float) -> float:
    """What the function answers to noise of shape (steps, 2) [sigma], which is its own to change.

    Raises:
        SimulatorError: it raised, took too long, or answered what is not one finite number.
    """
    try:
        with at_most(limit_s):
            answer = np.asarray(function(noise.reshape(*function.leading, *noise.shape)))
    except TookTooLong:
        remedy = "Make it faster, or raise `limit_s`."
        raise SimulatorError(f"The function took longer than {limit_s:g} s.", remedy) from None
    except (Exception, SystemExit) as error:
        told = f"The function raised {last_line(error)}."
        raise SimulatorError(told, f"Look at {where(error)}.") from error
    return _checked(answer, function.leading)


def _checked(answer: np.ndarray, shape: tuple[int, ...]) -> float:
    if answer.shape != shape or answer.dtype.kind not in NUMBERS:
        raise SimulatorError(
            f"The function returned an array of shape {answer.shape} and type {answer.dtype}.",
            f"It must return real numbers of shape {shape}.",
        )
    robustness = float(answer.item())
    if not isfinite(robustness):
        problem = f"The function returned {robustness}."
        raise SimulatorError(problem, "Robustness must be a finite number.")
    return robustness
