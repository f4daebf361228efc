"""Quantile to quantile, against scipy and against the definition."""

from math import exp, inf, nan

import numpy as np
import pytest
import scipy.stats
from hypothesis import given, settings
from hypothesis import strategies as st

from eigenfail.values.student_t import (
    REACH,
    log_t_density,
    log_t_slope,
    map_normal_to_t,
    map_t_to_normal,
    split_t_mass,
)

DEGREES = (2.01, 2.5, 3.0, 5.0, 30.0, 1000.0)
sound = settings(deadline=None, derandomize=True, max_examples=150)


@pytest.mark.parametrize("nu", DEGREES)
def test_quantiles_are_scipys_in_both_tails(nu: float) -> None:
    z = np.linspace(0.01, 12.0, 700)
    reference = scipy.stats.t.isf(scipy.stats.norm.sf(z), nu)
    assert [map_normal_to_t(each, nu) for each in z] == pytest.approx(reference, rel=1e-9)
    assert [map_normal_to_t(-each, nu) for each in z] == pytest.approx(-reference, rel=1e-9)


@pytest.mark.parametrize("nu", DEGREES)
def test_both_sides_of_t_have_the_mass_of_their_normals(nu: float) -> None:
    for z in np.linspace(0.003, 15.9, 300):
        t = map_normal_to_t(z, nu)
        assert scipy.stats.t.logsf(t, nu) == pytest.approx(scipy.stats.norm.logsf(z), abs=1e-9)


def test_with_two_degrees_of_freedom_the_tails_are_a_square_root() -> None:
    # T(t) = 1/2 + t / (2 sqrt(2 + t²)), so P(|T| < t) = t / sqrt(2 + t²)
    for t in (1e-6, 0.1, 1.0, 7.0):
        assert split_t_mass(t, 2.0)[0] == pytest.approx(t / (2.0 + t * t) ** 0.5, rel=1e-12)
    assert split_t_mass(1e8, 2.0)[1] == pytest.approx(
        1e-16, rel=1e-12
    )  # 1 - 1/sqrt(1 + 2/t²) = 1/t²


@pytest.mark.parametrize("nu", DEGREES)
def test_masses_are_scipys_far_out_and_near_the_middle(nu: float) -> None:
    for t in np.geomspace(1e-9, 1e4, 120):
        inside, outside = split_t_mass(t, nu)
        assert outside == pytest.approx(2.0 * scipy.stats.t.sf(t, nu), rel=1e-10, abs=1e-300)
        middle = scipy.special.betainc(0.5, 0.5 * nu, t * t / (nu + t * t))
        assert inside == pytest.approx(middle, rel=1e-10)


@pytest.mark.parametrize("nu", DEGREES)
def test_the_slope_is_the_ratio_of_the_densities_and_the_derivative(nu: float) -> None:
    for z in np.linspace(-8.0, 8.0, 65):
        t = map_normal_to_t(z, nu)
        assert log_t_density(t, nu) == pytest.approx(scipy.stats.t.logpdf(t, nu), rel=1e-10)
        rise = (map_normal_to_t(z + 1e-4, nu) - map_normal_to_t(z - 1e-4, nu)) / 2e-4
        assert exp(log_t_slope(z, nu)) == pytest.approx(rise, rel=1e-5)


@sound
@given(z=st.floats(-15.0, 15.0), nu=st.sampled_from(DEGREES))
def test_there_and_back(z: float, nu: float) -> None:
    assert map_t_to_normal(map_normal_to_t(z, nu), nu) == pytest.approx(z, abs=1e-9)
    assert map_normal_to_t(-z, nu) == -map_normal_to_t(z, nu)


@sound
@given(z=st.floats(-15.0, 14.9), step=st.floats(1e-6, 0.1), nu=st.sampled_from(DEGREES))
def test_more_stays_more(z: float, step: float, nu: float) -> None:
    assert map_normal_to_t(z + step, nu) > map_normal_to_t(z, nu)


@pytest.mark.parametrize("nu", DEGREES)
@pytest.mark.parametrize("beyond", [REACH, 17.0, 1e30, inf, nan])
def test_beyond_reach_it_stays_where_it_is(beyond: float, nu: float) -> None:
    assert map_normal_to_t(beyond, nu) == map_normal_to_t(REACH, nu) < 1e40
    assert log_t_slope(beyond, nu) == log_t_slope(REACH, nu)
    assert map_t_to_normal(1e200, nu) == pytest.approx(REACH)
    assert map_t_to_normal(-1e200, nu) == pytest.approx(-REACH)
