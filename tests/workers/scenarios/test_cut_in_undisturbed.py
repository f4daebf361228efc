"""Without noise the cut-in harms nobody: `rulebook` everywhere in the declared bounds, and `idm`,
which brakes late, with the brakes of the paper's truck.
"""

from itertools import product

import msgspec
import numpy as np
import pytest

from eigenfail.values.disturbance import DisturbanceModel
from eigenfail.values.episode import EpisodeSetup, EpisodeTask, TrajectorySource
from eigenfail_workers.engine import Engine
from eigenfail_workers.scenarios.cut_in import CutInParameters

UNDISTURBED = EpisodeTask(0, 0, TrajectorySource(np.zeros((0, 2), np.float32)))


def grid():
    """Smallest, default and largest value of each parameter: 81 of the 19683 combinations.

    Every combination of the values of any three parameters is among them (an orthogonal array of
    strength 3), so a failure that takes three parameters at most is met. All 729 with the default
    durations and brakes are run by `benchmarks/truth/undisturbed.py`.
    """
    (schema,) = msgspec.json.schema(CutInParameters)["$defs"].values()
    fields = schema["properties"]
    levels = [(field["minimum"], field["default"], field["maximum"]) for field in fields.values()]
    places = [
        (a, b, c, d, b + c + d, a + c + d, a + b + 2 * d, a + b + 2 * c, a + 2 * (b + d) + c)
        for a, b, c, d in product(range(3), repeat=4)
    ]
    return [
        {name: level[at % 3] for name, level, at in zip(fields, levels, row, strict=True)}
        for row in places
    ]


@pytest.fixture(scope="module")
def sweep():
    """The undisturbed run of a planner at each point of the grid."""

    def run(planner, **fixed):
        for parameters in grid():
            setup = EpisodeSetup(
                "highway", "cut_in", parameters | fixed, planner, {}, DisturbanceModel(), 1
            )
            yield from Engine(setup).run([UNDISTURBED])

    return run


def test_the_bounds_hold_the_distances_to_which_failures_are_moved():
    distances = {parameters["distance_m"] for parameters in grid()}
    assert min(distances) <= CutInParameters().distance_m - 5.0
    assert max(distances) >= CutInParameters().distance_m + 5.0


def test_the_rulebook_is_a_calm_driver(sweep):
    results = list(sweep("rulebook"))
    assert len(results) == 3**4
    for result, parameters in zip(results, grid(), strict=True):
        acceleration = result.scene.controls[:, 0]
        assert not result.is_failure
        assert result.measures.robustness_m > 5.0
        assert acceleration.min() > -2.0
        assert np.abs(np.diff(acceleration)).max() <= 0.4 + 1e-6
        assert result.scene.vehicles[-1, 0, 3] > 11.0
        came_over_to_m = result.scene.vehicles[-1, 1, 1]
        assert came_over_to_m == pytest.approx(parameters["final_offset_m"], abs=1e-4)


def test_the_baseline_is_safe(sweep):
    results = list(sweep("idm", peak_braking_mps2=7.0))
    assert len(results) == 3**4
    assert [result for result in results if result.is_failure] == []
    assert min(result.measures.robustness_m for result in results) > 1.0


def test_the_baseline_brakes_too_late_for_weak_brakes(sweep):
    assert any(result.is_failure for result in sweep("idm", peak_braking_mps2=3.0))
