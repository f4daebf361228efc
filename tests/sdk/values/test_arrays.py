"""Arrays of float32: what is read from JSON is not made infinite."""

import numpy as np
import pytest

from eigenfail.errors import InvalidValue, ProtocolError
from eigenfail.values.arrays import decode_array
from eigenfail.values.disturbance import NoiseTrajectory
from eigenfail.values.shapes import White


def test_numbers_beyond_float32_are_refused() -> None:
    with pytest.raises(ProtocolError, match=r"1e\+39"):
        decode_array(np.ndarray, [[1.0, 1e39]])
    assert decode_array(np.ndarray, [[1.0, 3e38]]).dtype == np.float32


def test_noise_beyond_float32_is_refused() -> None:
    sigma = np.full((1, 2), 0.5, np.float32)
    with pytest.raises(InvalidValue, match="sigma is beyond"):
        NoiseTrajectory.from_injected(np.array([[1e39, 0.0]]), sigma, White())
