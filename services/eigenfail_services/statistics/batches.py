"""Batches of noise that estimators request: one by one, in waves, or in parallel.

An estimator is a generator. It yields the batches that it can request now, or none if it waits for
earlier batches. It receives the robustness of the oldest unanswered batch. So the order of batches
and answers follows only from the robustness. Neither the workers nor the order in which
trajectories end have an effect.
"""

from collections import deque
from collections.abc import Callable, Generator, Sequence
from math import ceil

import numpy as np
from numpy.typing import NDArray

from eigenfail.errors import InvalidValue
from eigenfail.values.learning import choose_group_size

Array = NDArray[np.float64]

NoiseShape = tuple[int, int]
"""Number of steps of a trajectory, and of channels of its noise."""

Batches = tuple[Array, ...]
"""Each has trajectories z, shape (n, steps, channels), n >= 1."""

Requests = Generator[Batches, Array, None]
"""Yields batches; is sent the robustness of one of them, shape (n,), NaN where errored."""


class Requester:
    """Drives a generator of requests, so that callers need not catch its end.

    Args:
        requests: generator that has not started.
    """

    def __init__(self, requests: Requests) -> None:
        self._requests = requests

    def start(self) -> Batches:
        """Return the first batches; empty if nothing is requested."""
        return self._resume(lambda: next(self._requests))

    def answer(self, robustness: Array) -> Batches:
        """Send the robustness of the oldest batch, and return the next batches."""
        return self._resume(lambda: self._requests.send(robustness))

    @staticmethod
    def _resume(step: Callable[[], Batches]) -> Batches:
        try:
            return step()
        except StopIteration:
            return ()


def run_side_by_side(parts: Sequence[Requests]) -> Requests:
    """Request the batches of all parts; each part continues after its own batch was run."""
    requesters = [Requester(part) for part in parts]
    new = [(one, batch) for one in requesters for batch in one.start()]
    waiting = deque(new)
    while waiting:
        robustness = yield tuple(batch for _, batch in new)
        oldest, _ = waiting.popleft()
        new = [(oldest, batch) for batch in oldest.answer(robustness)]
        waiting.extend(new)


def run_in_waves(parts: Sequence[Requests]) -> Requests:
    """Request the batches of all parts as one batch, after which all parts continue."""
    requesters = [Requester(part) for part in parts]
    wave = [(one, batch) for one in requesters for batch in one.start()]
    while wave:
        robustness = yield (np.concatenate([batch for _, batch in wave]),)
        ends = np.cumsum([len(batch) for _, batch in wave])[:-1]
        answers = zip(wave, np.split(robustness, ends), strict=True)
        wave = [(one, batch) for (one, _), part in answers for batch in one.answer(part)]


def divide_chains(chains: int, parallel: int | None) -> list[NDArray[np.intp]]:
    """Return the chain numbers in each group: with `parallel`, two or more even groups.

    Args:
        chains: number of chains.
        parallel: number of trajectories to run at a time; None for a single group.
    """
    # Two at least: while the last episodes of one group run, the other group keeps workers
    # busy.
    wanted = max(ceil(chains / choose_group_size(parallel)), 2) if parallel else 1
    return np.array_split(np.arange(chains), min(wanted, chains))


Robustness = Callable[[Array], Array]
"""Robustness of a batch of noise z, shape (n, steps, channels): n finite numbers."""


def answer_requests(requests: Requests, robustness: Robustness) -> None:
    """Answer all requests with a function's values.

    Raises:
        InvalidValue: robustness is not finite, or not one value for each trajectory.
    """
    requester = Requester(requests)
    waiting = deque(requester.start())
    while waiting:
        waiting.extend(requester.answer(evaluate_robustness(robustness, waiting.popleft())))


def evaluate_robustness(robustness: Robustness, z: Array) -> Array:
    """Return the robustness of each z.

    Raises:
        InvalidValue: robustness is not finite, or not one value for each trajectory.
    """
    values = np.asarray(robustness(z), np.float64)
    if values.shape != z.shape[:1] or not np.isfinite(values).all():
        raise InvalidValue(
            "robustness",
            f"{len(z)} trajectories gave values of shape {values.shape}, or not finite ones.",
            "Return one finite number for each trajectory.",
        )
    return values
