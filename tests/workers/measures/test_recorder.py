"""What the record of an episode says, against its observations."""

from math import inf, nan

import numpy as np
import pytest

from eigenfail.errors import SimulatorError
from eigenfail.values import Control, Observation, VehicleState
from eigenfail_workers.measures.recorder import Recorder, severity


def car(x: float, y: float, speed: float, heading: float = 0.0) -> VehicleState:
    return VehicleState(x, y, heading, speed, 4.0, 2.0)


def seen(step: int, ego_x: float, collided: bool = False) -> Observation:
    """An ego at 10 m/s and a standing car 20 m ahead of the start; another one 6 m aside."""
    others = (car(24.0, 0.0, 0.0), car(0.0, 8.0, 10.0))
    past = {"perceived": (25.0, 0.5), "control": Control(-1.0, 0.1)} if step else {}
    return Observation(step, car(ego_x, 0.0, 10.0), others, collided, collided, **past)


def recorded(*observations: Observation) -> Recorder:
    recorder = Recorder()
    for observation in observations:
        recorder.sees(observation)
        recorder.injects((0.5, -0.25), (2.0, 0.25))
    return recorder


def test_the_start_counts_for_robustness() -> None:
    assert recorded(seen(0, 0.0)).measures().robustness_m == 6.0


def test_measures_are_extremes_over_the_episode() -> None:
    measures = recorded(seen(0, 0.0), seen(1, 16.0), seen(2, 15.0)).measures()
    assert measures.robustness_m == 4.0
    assert measures.min_ttc_s == pytest.approx(0.4)
    assert measures.max_drac_mps2 == pytest.approx(100.0 / 8.0)
    assert measures.severity is None


def test_a_collision_has_robustness_zero_and_reads_drac_before_it() -> None:
    recorder = recorded(seen(0, 0.0), seen(1, 19.0), seen(2, 20.5, collided=True))
    measures = recorder.measures()
    assert recorder.collided
    assert measures.robustness_m == 0.0
    assert measures.max_drac_mps2 == pytest.approx(100.0 / 2.0)
    assert measures.severity == pytest.approx(100.0)


def test_without_closing_in_there_is_neither_ttc_nor_drac() -> None:
    alone = Observation(0, car(0.0, 0.0, 10.0), (car(30.0, 0.0, 10.0),))
    measures = recorded(alone).measures()
    assert (measures.min_ttc_s, measures.max_drac_mps2) == (None, None)


def test_severity_is_of_the_touched_vehicle_and_of_the_vector_difference() -> None:
    touched = car(3.0, 1.0, 5.0, np.pi / 2)
    observation = Observation(3, car(0.0, 0.0, 10.0), (car(0.0, 9.0, 30.0), touched), True, True)
    assert severity(observation) == pytest.approx(10.0**2 + 5.0**2)


def test_severity_of_two_touched_vehicles_is_of_the_deeper_one() -> None:
    others = (car(3.9, 0.0, 9.0), car(2.0, 0.0, 4.0))
    assert severity(Observation(1, car(0.0, 0.0, 10.0), others, True, True)) == pytest.approx(36.0)


def test_noise_is_float32_also_when_there_is_none() -> None:
    empty = Recorder().noise()
    assert empty.z.shape == empty.sigma.shape == (0, 2)
    noise = recorded(seen(0, 0.0)).noise()
    assert noise.z.dtype == noise.sigma.dtype == np.float32
    assert noise.metres.tolist() == [[1.0, -0.0625]]


def test_the_scene_has_one_row_more_than_steps() -> None:
    scene = recorded(seen(0, 0.0), seen(1, 1.0), seen(2, 2.0)).scene(0.1)
    assert scene.vehicles.shape == (3, 3, 4)
    assert scene.vehicles[:, 0, 0].tolist() == [0.0, 1.0, 2.0]
    assert scene.vehicles[0, 2].tolist() == [0.0, 8.0, 0.0, 10.0]
    assert scene.sizes.tolist() == [[4.0, 2.0]] * 3
    assert scene.perceived.tolist() == [[25.0, 0.5]] * 2
    assert scene.controls == pytest.approx(np.array([[-1.0, 0.1]] * 2), rel=1e-6)


@pytest.mark.parametrize("nowhere", [nan, inf])
def test_a_vehicle_that_is_nowhere_is_refused(nowhere: float) -> None:
    with pytest.raises(SimulatorError, match="finite"):
        Recorder().sees(seen(0, nowhere))
