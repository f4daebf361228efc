"""Noise trajectories: z to metres and back, and their likelihood."""

import msgspec
import numpy as np
import pytest
import scipy.stats
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from eigenfail.values import episode
from eigenfail.values.disturbance import (
    TRAJECTORIES_AT_A_TIME,
    Conversion,
    DisturbanceModel,
    NoiseTrajectory,
    sum_log_densities,
)
from eigenfail.values.shapes import Correlated, HeavyTailed, Shape, White
from eigenfail.wire import messages

SHAPES: tuple[Shape, ...] = (White(), Correlated(0.95, 0.3), HeavyTailed(2.5), HeavyTailed(5.0))
some_shape = st.sampled_from(SHAPES)
ONE_BY_ONE = tuple(shape for shape in SHAPES if not isinstance(shape, Correlated))
"""Shapes that take any number of channels."""

some_z = arrays.arrays(
    np.float32, st.tuples(st.integers(0, 12), st.just(2)), elements=st.floats(-8, 8, width=32)
)
sound = settings(deadline=None, derandomize=True, max_examples=100)


def sigmas(z: np.ndarray, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).uniform(0.1, 50.0, z.shape).astype(np.float32)


@sound
@given(z=some_z)
def test_white_is_the_papers_closed_form_bit_for_bit(z: np.ndarray) -> None:
    sigma = sigmas(z)
    noise = NoiseTrajectory(z, sigma)
    assert noise.injected.tobytes() == (z.astype(np.float64) * sigma).tobytes()
    assert noise.standardised.tobytes() == z.astype(np.float64).tobytes()
    wide, deep = z.astype(np.float64), sigma.astype(np.float64)
    log_p = -0.5 * wide**2 - np.log(deep) - 0.5 * np.log(2.0 * np.pi)
    assert noise.log_probability_per_step.tobytes() == (log_p[:, 0] + log_p[:, 1]).tobytes()
    reference = scipy.stats.norm(scale=deep).logpdf(noise.injected).sum()
    assert noise.log_probability == pytest.approx(reference, rel=1e-12, abs=1e-12)


@pytest.mark.parametrize("shape", SHAPES, ids=str)
def test_log_probabilities_of_many_are_those_of_each_bit_for_bit(shape: Shape) -> None:
    lengths = np.random.default_rng(3).integers(0, 40, 2 * TRAJECTORIES_AT_A_TIME + 1)
    draws = [np.random.default_rng(n).standard_normal((n, 2), np.float32) for n in lengths]
    many = [NoiseTrajectory(z, sigmas(z, seed), shape) for seed, z in enumerate(draws)]
    assert sum_log_densities(many) == [each.log_probability for each in many]
    assert sum_log_densities(many) == [each.log_probability_per_step.sum() for each in many]
    assert sum_log_densities([]) == []


@sound
@given(z=some_z, shape=some_shape)
def test_there_and_back(z: np.ndarray, shape: Shape) -> None:
    noise = NoiseTrajectory(z, sigmas(z), shape)
    back = NoiseTrajectory.from_injected(noise.injected, noise.sigma, shape)
    assert back.z.dtype == np.float32
    np.testing.assert_allclose(back.z, z, rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(back.injected, noise.injected, rtol=1e-4, atol=1e-4)


@sound
@given(z=some_z, shape=some_shape)
def test_step_by_step_gives_the_very_same_metres(z: np.ndarray, shape: Shape) -> None:
    noise, conversion = NoiseTrajectory(z, sigmas(z), shape), Conversion(shape)
    rows = zip(z.tolist(), noise.sigma.tolist(), strict=True)
    metres = [conversion.inject(tuple(each), tuple(at)) for each, at in rows]
    assert metres == [tuple(row) for row in noise.injected.tolist()]


@sound
@given(z=some_z.filter(len), shape=some_shape)
def test_a_later_step_changes_nothing_before_it(z: np.ndarray, shape: Shape) -> None:
    whole = NoiseTrajectory(z, sigmas(z), shape)
    start = NoiseTrajectory(z[:-1], whole.sigma[:-1], shape)
    assert start.injected.tolist() == whole.injected[:-1].tolist()
    assert start.log_probability_per_step.tolist() == whole.log_probability_per_step[:-1].tolist()


@sound
@given(
    z=arrays.arrays(
        np.float32,
        st.tuples(st.integers(0, 12), st.integers(1, 6)),
        elements=st.floats(-8, 8, width=32),
    ),
    shape=st.sampled_from(ONE_BY_ONE),
)
def test_each_channel_is_converted_and_weighed_by_itself(z: np.ndarray, shape: Shape) -> None:
    whole = NoiseTrajectory(z, sigmas(z), shape)
    columns = [NoiseTrajectory(z[:, [at]], whole.sigma[:, [at]], shape) for at in range(z.shape[1])]
    for at, column in enumerate(columns):
        assert column.injected[:, 0].tolist() == whole.injected[:, at].tolist()
    assert whole.log_probability == pytest.approx(
        sum(column.log_probability for column in columns), rel=1e-12, abs=1e-12
    )
    back = NoiseTrajectory.from_injected(whole.injected, whole.sigma, shape)
    np.testing.assert_allclose(back.z, z, rtol=1e-6, atol=1e-6)


def test_the_density_of_heavy_tails_is_students_in_metres() -> None:
    z = np.linspace(-7.0, 7.0, 40).astype(np.float32).reshape(-1, 2)
    noise = NoiseTrajectory(z, sigmas(z), HeavyTailed(3.0))
    student = scipy.stats.t(3.0, scale=noise.sigma * np.sqrt(1.0 / 3.0))
    np.testing.assert_allclose(
        noise.log_probability_per_step, student.logpdf(noise.injected).sum(axis=1), rtol=1e-6
    )


def test_the_density_of_correlated_noise_is_the_multivariate_normals() -> None:
    z = np.random.default_rng(2).standard_normal((6, 2)).astype(np.float32)
    noise = NoiseTrajectory(z, sigmas(z), Correlated(0.7, 0.4))
    apart = np.abs(np.subtract.outer(np.arange(6), np.arange(6)))
    reference = 0.0
    for axis, phi in enumerate((0.7, 0.4)):
        sigma = noise.sigma[:, axis].astype(np.float64)
        covariance = np.outer(sigma, sigma) * phi**apart
        normal = scipy.stats.multivariate_normal(cov=covariance)
        reference += normal.logpdf(noise.injected[:, axis])
    assert noise.log_probability == pytest.approx(reference, rel=1e-9)


def test_two_steps_of_correlated_noise_by_hand() -> None:
    conversion = Conversion(Correlated(0.6, 0.0))
    assert conversion.inject((1.0, 2.0), (2.0, 0.5)) == (2.0, 1.0)
    # u = 0.6 · 1 + 0.8 · (-1) = -0.2; no correlation leaves z as it is
    assert conversion.inject((-1.0, 3.0), (10.0, 1.0)) == pytest.approx((-2.0, 3.0))


@pytest.mark.parametrize("shape", SHAPES, ids=str)
@pytest.mark.parametrize("wild", [np.inf, -np.inf, np.nan, 3e38])
def test_numbers_that_no_worker_should_send_raise_nothing(wild: float, shape: Shape) -> None:
    z = np.array([[wild, 0.0], [1.0, wild]], np.float32)
    noise = NoiseTrajectory(z, np.ones_like(z), shape)
    assert noise.injected.shape == (2, 2)
    assert not noise.log_probability > 0.0


def result(shape: Shape) -> episode.EpisodeResult:
    z = np.random.default_rng(0).standard_normal((5, 2)).astype(np.float32)
    lost = episode.unrunnable(
        episode.EpisodeTask(0, 1, episode.PriorSource()), episode.EpisodeFault("input", "test")
    )
    return msgspec.structs.replace(lost, steps=5, noise=NoiseTrajectory(z, sigmas(z), shape))


@pytest.mark.parametrize("shape", SHAPES, ids=str)
def test_the_shape_travels_with_the_noise_and_with_the_setup(shape: Shape) -> None:
    sent = result(shape)
    read = messages.read_worker_message(messages.encode(messages.Results(7, (sent,))))
    (arrived,) = read.results
    assert arrived.noise.shape == shape
    assert arrived.noise.log_probability == sent.noise.log_probability
    assert arrived.noise.injected.tobytes() == sent.noise.injected.tobytes()
    model = DisturbanceModel(scale=2.0, shape=shape)
    setup = episode.EpisodeSetup("highway", "cut_in", {}, "idm", {}, model)
    read = messages.read_hub_message(messages.encode(messages.Setup(7, setup)))
    assert read.setup == setup
