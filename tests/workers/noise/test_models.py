"""The disturbance model's closed form."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from eigenfail.values.channels import Channel
from eigenfail.values.disturbance import DisturbanceModel
from eigenfail.values.scene import Observation, VehicleState
from eigenfail.values.shapes import Row
from eigenfail_workers.noise.deviations import Deviations, to_float32


def at(x: float, y: float) -> VehicleState:
    return VehicleState(x, y, 0.0, 0.0, 5.0, 2.0)


def compute_deviations(model: DisturbanceModel, ego: VehicleState, actor: VehicleState) -> Row:
    return Deviations(model).compute(Observation(0, ego, (actor,)), 0)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_paper_equation_3(sign: float) -> None:
    sigma = compute_deviations(
        DisturbanceModel(), at(10.0, 1.0), at(10.0 + sign * 50.0, 1.0 + sign * 3.2)
    )
    assert sigma == pytest.approx((0.02 * 50.0 + 1.0, 0.00625 * 3.2 + 0.2), rel=1e-6)


@settings(deadline=None, derandomize=True, max_examples=100)
@given(st.floats(-500.0, 500.0), st.floats(-10.0, 10.0))
def test_what_is_stored_is_what_was_used(x: float, y: float) -> None:
    for sigma in compute_deviations(DisturbanceModel(), at(0.0, 0.0), at(x, y)):
        assert float(np.float32(sigma)) == sigma


def test_the_scale_multiplies_both_sigmas() -> None:
    model = DisturbanceModel(0.5, 3.0, 0.25, 2.0, scale=1.5)
    assert compute_deviations(model, at(0.0, 0.0), at(4.0, 8.0)) == (7.5, 6.0)


@settings(deadline=None, derandomize=True, max_examples=100)
@given(st.floats(-1e30, 1e30))
def test_rounding_is_numpys(value: float) -> None:
    assert to_float32(value) == float(np.float32(value))


def test_each_channel_has_the_distance_of_its_own_vehicle() -> None:
    channels = (
        Channel("vehicle_2.longitudinal", 1.0, 0.5),
        Channel("vehicle_2.speed", 1.0, 0.5),
        Channel("lateral", 1.0, 0.5),
        Channel("ego.speed", 0.25, 0.5),
        Channel("missed"),
    )
    truth = Observation(0, at(0.0, 0.0), (at(4.0, 8.0), at(-6.0, 8.0)))
    found = Deviations(DisturbanceModel(scale=2.0, channels=channels)).compute(truth, 0)
    assert found == (8.0, 12.0, 10.0, 0.5, 1.0)
