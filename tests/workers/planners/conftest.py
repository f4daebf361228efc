"""Drives planners through the default cut-in on the real simulator."""

from collections.abc import Callable

import numpy as np
import pytest

from eigenfail.values.disturbance import DisturbanceModel
from eigenfail.values.episode import EpisodeResult, EpisodeSetup, EpisodeTask, TrajectorySource
from eigenfail.values.scene import Mission, VehicleState
from eigenfail_workers.engine import Engine

Drive = Callable[..., EpisodeResult]


@pytest.fixture
def drive() -> Drive:
    """Run noise z, shape (steps, 2), in a cut-in; engines are kept from call to call.

    No longer than a test: pytest-timeout sets a handler of SIGALRM for each test, and an engine
    compares the process-wide state with that at its creation.
    """
    engines: dict[tuple, Engine] = {}

    def run(z=(), planner="rulebook", **parameters) -> EpisodeResult:
        key = (planner, tuple(parameters.items()))
        if key not in engines:
            setup = EpisodeSetup(
                "highway", "cut_in", parameters, planner, {}, DisturbanceModel(), 1
            )
            engines[key] = Engine(setup)
        noise = np.asarray(z, np.float32).reshape(-1, 2)
        (result,) = engines[key].run([EpisodeTask(0, 0, TrajectorySource(noise))])
        assert result.fault is None, result.fault
        return result

    return run


@pytest.fixture
def mission() -> Mission:
    return Mission(0.1, 2, 3.5, 25.0, 24.0, 1000.0)


@pytest.fixture
def truck() -> VehicleState:
    return VehicleState(0.0, 0.0, 0.0, 24.0, 16.0, 2.5)


@pytest.fixture
def car() -> Callable[[float, float], VehicleState]:
    """A car at a position, driving 12 m/s."""
    return lambda x_m, y_m: VehicleState(x_m, y_m, 0.0, 12.0, 5.0, 2.0)
