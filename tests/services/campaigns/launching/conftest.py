"""Launchers in played time, with a hub whose work a test gives it."""

import pytest

from eigenfail_services.hub.metrics import WorkerDemand


class Table:
    """A hub with the work that a test gives it."""

    def __init__(self) -> None:
        self.demand = WorkerDemand()
        self.leaving: frozenset[str] = frozenset()

    def measure_demand(self) -> WorkerDemand:
        return self.demand

    def drain_workers(self, names) -> None:
        self.leaving = frozenset(names)


class Clock:
    """Time that a test moves on."""

    def __init__(self) -> None:
        self.now_s = 0.0

    def __call__(self) -> float:
        return self.now_s

    def pass_by(self, seconds: float, launcher, table: Table) -> None:
        """Let time pass, in which a launcher is polled four times a second."""
        for _ in range(int(4 * seconds)):
            self.now_s += 0.25
            launcher.poll(table)


@pytest.fixture
def table() -> Table:
    return Table()


@pytest.fixture
def clock() -> Clock:
    return Clock()
