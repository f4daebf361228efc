"""When a worker ends, why, and how long it waits for the hub to have what it has finished."""

import time

from eigenfail.errors import ServiceError

PATIENCE_S = 10.0


class Ending:
    """Nobody wants the end, at first.

    Attributes:
        wanted: whether nothing more is to be run.
        problem: what ends it, if nobody asked.
    """

    def __init__(self) -> None:
        self.wanted = False
        self.problem: ServiceError | None = None
        self._until_s = 0.0

    def ask(self) -> None:
        """End in order; who asks twice wants it at once. Safe to call from a signal handler."""
        self._until_s = 0.0 if self.wanted else time.monotonic() + PATIENCE_S
        self.wanted = True

    def ask_because(self, problem: ServiceError) -> None:
        """End in order, as it cannot go on."""
        self.problem = problem
        if not self.wanted:
            self.ask()

    @property
    def is_patient(self) -> bool:
        """Whether there still is time to wait."""
        return time.monotonic() < self._until_s

    def raise_problem(self) -> None:
        """Raises ServiceError if it was not asked to end, but could not go on."""
        if self.problem is not None:
            raise self.problem
