"""Shapes: unit variance, and a sampler that agrees with the density."""

from functools import cache
from math import e, log, pi

import msgspec
import numpy as np
import pytest
import scipy.stats
from numpy.typing import NDArray

from eigenfail.values.disturbance import DisturbanceModel, NoiseTrajectory
from eigenfail.values.shapes import Correlated, HeavyTailed, Shape, White

Doubles = NDArray[np.float64]

SHAPES: tuple[Shape, ...] = (White(), Correlated(0.9, 0.5), HeavyTailed(3.0), HeavyTailed(12.0))
STEPS = 40_000


@cache
def drawn(shape: Shape, seed: int = 1) -> NoiseTrajectory:
    """A long trajectory, drawn as the prior draws."""
    z = np.random.default_rng(seed).standard_normal((STEPS, 2), dtype=np.float32)
    return NoiseTrajectory(z, np.ones_like(z), shape)


def densities(u: Doubles, shape: Shape) -> Doubles:
    """p(u_0 = u) of the longitudinal axis, in units of sigma, by the log-probability of metres."""
    found = np.empty_like(u)
    for place, each in enumerate(u):
        metres = np.array([[each, 0.0]])
        noise = NoiseTrajectory.from_injected(metres, np.ones((1, 2), np.float32), shape)
        other = NoiseTrajectory.from_injected(0.0 * metres, noise.sigma, shape)
        found[place] = np.exp(noise.log_probability - 0.5 * other.log_probability)
    return found


def correlation(u: Doubles, lag: int) -> float:
    return float(np.corrcoef(u[lag:], u[:-lag])[0, 1])


@pytest.mark.parametrize("shape", SHAPES, ids=str)
def test_moments_of_what_is_drawn(shape: Shape) -> None:
    u = drawn(shape).standardised
    # a correlated sample is worth fewer draws: (1 - phi) / (1 + phi) of them
    assert u.mean(axis=0) == pytest.approx([0.0, 0.0], abs=0.06)
    assert u.var(axis=0) == pytest.approx([1.0, 1.0], abs=0.1)
    assert abs(np.corrcoef(u[:, 0], u[:, 1])[0, 1]) < 0.03


@pytest.mark.parametrize("shape", SHAPES, ids=str)
def test_correlation_from_step_to_step(shape: Shape) -> None:
    u = drawn(shape).standardised
    phi_x, phi_y = (0.9, 0.5) if isinstance(shape, Correlated) else (0.0, 0.0)
    for lag in (1, 2, 5):
        assert correlation(u[:, 0], lag) == pytest.approx(phi_x**lag, abs=0.03)
        assert correlation(u[:, 1], lag) == pytest.approx(phi_y**lag, abs=0.03)


def test_kurtosis() -> None:
    def kurtosis(shape: Shape) -> float:
        return float((drawn(shape).standardised ** 4).mean())

    assert kurtosis(White()) == pytest.approx(3.0, abs=0.1)
    assert kurtosis(Correlated(0.9, 0.5)) == pytest.approx(3.0, abs=0.2)
    # Student's t: 3 + 6 / (nu - 4)
    assert kurtosis(HeavyTailed(12.0)) == pytest.approx(3.75, abs=0.2)


@pytest.mark.parametrize("nu", [2.5, 5.0])
def test_what_is_drawn_follows_student(nu: float) -> None:
    u = drawn(HeavyTailed(nu)).standardised.ravel()
    t = u / np.sqrt((nu - 2.0) / nu)
    assert scipy.stats.kstest(t, scipy.stats.t(nu).cdf).pvalue > 0.01
    assert scipy.stats.kstest(t, scipy.stats.norm.cdf).pvalue < 1e-6


@pytest.mark.parametrize("shape", SHAPES, ids=str)
def test_the_density_of_one_step_integrates_to_one_with_unit_variance(shape: Shape) -> None:
    # u = sinh(s) reaches far into the tails; the trapezoidal rule is exact to many digits here
    s = np.linspace(-9.0, 9.0, 1201)
    u, width = np.sinh(s), np.cosh(s) * (s[1] - s[0])
    p = densities(u, shape)
    assert (p * width).sum() == pytest.approx(1.0, abs=1e-6)
    assert (p * u * width).sum() == pytest.approx(0.0, abs=1e-6)
    # of nu = 3, a share of 3e-4 of the variance is beyond |u| = sinh(9)
    assert (p * u**2 * width).sum() == pytest.approx(1.0, abs=1e-3)


def test_two_correlated_steps_integrate_to_one_and_each_is_standard_normal() -> None:
    axis = np.linspace(-7.0, 7.0, 57)
    shape, sigma = Correlated(0.8, 0.0), np.ones((2, 2), np.float32)
    still = NoiseTrajectory(0.0 * sigma[:1], sigma[:1]).log_probability  # of the lateral axis
    p = np.empty((len(axis), len(axis)))
    for i, first in enumerate(axis):
        for j, second in enumerate(axis):
            metres = np.array([[first, 0.0], [second, 0.0]])
            noise = NoiseTrajectory.from_injected(metres, sigma, shape)
            p[i, j] = np.exp(noise.log_probability - still)
    width = axis[1] - axis[0]
    assert p.sum() * width**2 == pytest.approx(1.0, abs=1e-5)
    normal = scipy.stats.norm.pdf(axis)
    assert p.sum(axis=0) * width == pytest.approx(normal, abs=1e-5)
    assert p.sum(axis=1) * width == pytest.approx(normal, abs=1e-5)
    together = scipy.stats.multivariate_normal(cov=[[1.0, 0.8], [0.8, 1.0]])
    assert p == pytest.approx(together.pdf(np.dstack(np.meshgrid(axis, axis))).T, abs=1e-5)


def entropy(shape: Shape) -> float:
    """What -log p of a step amounts to on average, over both axes, in units of sigma."""
    if isinstance(shape, HeavyTailed):
        nu = shape.degrees_of_freedom
        return 2.0 * float(scipy.stats.t(nu, scale=np.sqrt((nu - 2.0) / nu)).entropy())
    kept = (0.9, 0.5) if isinstance(shape, Correlated) else (0.0, 0.0)
    return sum(0.5 * log(2.0 * pi * e * (1.0 - phi**2)) for phi in kept)


@pytest.mark.parametrize("shape", SHAPES, ids=str)
def test_log_p_of_what_is_drawn_is_the_entropy_on_average(shape: Shape) -> None:
    assert drawn(shape).log_probability / STEPS == pytest.approx(-entropy(shape), abs=0.02)


@pytest.mark.parametrize("shape", [*SHAPES, Correlated(0.99, 0.0)], ids=str)
def test_log_slopes_are_those_of_the_whole_jacobian(shape: Shape) -> None:
    z, h = np.random.default_rng(3).standard_normal((4, 2)), 1e-3
    columns = []
    for place in range(8):
        moved = [z.copy(), z.copy()]
        moved[0].flat[place] += h
        moved[1].flat[place] -= h
        up, down = (NoiseTrajectory(m, np.ones((4, 2), np.float32), shape) for m in moved)
        columns.append((up.standardised - down.standardised).ravel() / (2.0 * h))
    _, log_determinant = np.linalg.slogdet(np.array(columns))
    assert shape.log_slopes(z, np.ones_like(z)).sum() == pytest.approx(log_determinant, abs=1e-4)


@pytest.mark.parametrize("shape", SHAPES, ids=str)
def test_a_model_comes_back_from_json_with_its_shape(shape: Shape) -> None:
    model = DisturbanceModel(scale=1.5, shape=shape)
    text = msgspec.json.encode(model)
    assert msgspec.json.decode(text, type=DisturbanceModel) == model
    assert msgspec.json.decode(text)["shape"]["kind"] in {"white", "ar1", "student_t"}


def test_a_model_without_a_shape_is_the_papers() -> None:
    assert msgspec.json.decode(b'{"lateral_base_m": 0.2}', type=DisturbanceModel) == (
        DisturbanceModel(0.02, 1.0, 0.00625, 0.2, 1.0, White())
    )


@pytest.mark.parametrize(
    "wrong",
    [
        '{"scale": 0}',
        '{"scale": 10.5}',
        '{"shape": {"kind": "ar1", "lateral_correlation": 1.0}}',
        '{"shape": {"kind": "ar1", "longitudinal_correlation": -0.1}}',
        '{"shape": {"kind": "ar1", "degrees_of_freedom": 5}}',
        '{"shape": {"kind": "student_t", "degrees_of_freedom": 2}}',
        '{"shape": {"kind": "pink"}}',
        '{"shape": {}}',
    ],
)
def test_what_is_outside_its_bounds_is_refused(wrong: str) -> None:
    with pytest.raises(msgspec.ValidationError):
        msgspec.json.decode(wrong, type=DisturbanceModel)


def test_people_read_what_the_model_is() -> None:
    words = DisturbanceModel(scale=1.5, shape=Correlated(0.9, 0.25)).in_words()
    assert words == {
        "longitudinal sigma": "0.02·|dx| + 1 m",
        "lateral sigma": "0.00625·|dy| + 0.2 m",
        "scale": "both sigmas × 1.5",
        "shape": "ar1: normal, correlated from step to step by "
        "0.9 (longitudinal) and 0.25 (lateral)",
    }
    assert HeavyTailed(5.0).in_words().startswith("student_t: heavy tails of 5 degrees")
    assert White().in_words().startswith("white: normal, independent")
