"""Density and coverage against hand-worked cases and what is expected of the same distribution."""

import numpy as np
import pytest
from sample_quality import sample_quality

from eigenfail.errors import InvalidValue

LINE = np.array([[0.0], [1.0], [2.0], [10.0]])


def test_density_and_coverage_match_a_hand_calculation():
    # k = 1: balls [-1, 1], [0, 2], [1, 3], [2, 18]. Of 0.5 and 30, 0.5 lies in the first two.
    found = sample_quality(LINE, [[0.5], [30.0]], neighbours=1)
    assert found.density == pytest.approx((2 + 0) / (1 * 2))
    assert found.coverage == pytest.approx(2 / 4)


def test_the_same_distribution_has_density_one_and_nearly_full_coverage():
    random = np.random.default_rng(1)
    found = sample_quality(random.standard_normal((1000, 3)), random.standard_normal((1000, 3)))
    assert found.density == pytest.approx(1.0, abs=0.07)
    assert found.coverage == pytest.approx(1.0 - 2.0**-5, abs=0.02)


def test_a_missing_mode_halves_coverage_and_not_density():
    random = np.random.default_rng(2)
    sides = np.where(np.arange(600) % 2, 8.0, -8.0)[:, None]
    real = random.standard_normal((600, 2)) + sides
    found = sample_quality(real, random.standard_normal((600, 2)) + 8.0)
    assert found.coverage == pytest.approx(0.5, abs=0.03)
    assert found.density == pytest.approx(1.0, abs=0.12)


def test_samples_that_are_too_wide_have_a_low_density():
    random = np.random.default_rng(3)
    real = random.standard_normal((600, 2))
    assert sample_quality(real, 5.0 * random.standard_normal((600, 2))).density < 0.2


@pytest.mark.parametrize(
    ("real", "generated", "problem"),
    [
        (LINE[:2], LINE, "do not fit k = 2"),
        (LINE, LINE[:0], "do not fit"),
        (LINE, np.zeros((3, 2)), "do not fit"),
        (LINE, np.zeros(3), "no table"),
        (LINE, [[float("nan")]], "no table"),
    ],
)
def test_what_cannot_be_judged_is_refused(real, generated, problem):
    with pytest.raises(InvalidValue, match=problem):
        sample_quality(real, generated, neighbours=2)
