"""Mixtures of normals: densities and draws of known mixtures, fits to known samples."""

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from eigenfail_services.statistics.gaussian_mixture import (
    LEAST_BROAD_SHARE,
    NARROWEST,
    WIDEST,
    MixtureProposal,
    NormalComponent,
    add_broad_components,
    fit_mixture,
    make_prior_proposal,
    make_round_component,
    make_scaled_proposal,
)

ROTATED = np.array([[0.6, -0.8], [0.8, 0.6]])
TILTED = NormalComponent(np.array([1.0, -2.0]), ROTATED, np.array([0.5, 1.5]))
MIXTURE = MixtureProposal(
    np.array([0.1, 0.3, 0.6]),
    (make_round_component(np.zeros(2), 4.0), make_round_component(np.array([3.0, 0.0])), TILTED),
    1,
)


def test_the_log_density_is_that_of_the_mixture():
    z = np.random.default_rng(1).normal(0.0, 2.0, (50, 2))
    covariance = ROTATED @ np.diag([0.5, 1.5]) @ ROTATED.T
    expected = (
        0.1 * multivariate_normal.pdf(z, np.zeros(2), 4.0 * np.eye(2))
        + 0.3 * multivariate_normal.pdf(z, [3.0, 0.0], np.eye(2))
        + 0.6 * multivariate_normal.pdf(z, [1.0, -2.0], covariance)
    )
    assert np.exp(MIXTURE.log_density(z)) == pytest.approx(expected)


def test_draws_have_the_mean_and_the_covariance_of_the_mixture():
    z = MIXTURE.draw(200_000, np.random.default_rng(2))
    mean = 0.3 * np.array([3.0, 0.0]) + 0.6 * TILTED.mean
    second = (
        0.1 * 4.0 * np.eye(2)
        + 0.3 * (np.eye(2) + np.outer([3.0, 0.0], [3.0, 0.0]))
        + 0.6 * (ROTATED @ np.diag([0.5, 1.5]) @ ROTATED.T + np.outer(TILTED.mean, TILTED.mean))
    )
    assert z.mean(axis=0) == pytest.approx(mean, abs=0.02)
    assert z.T @ z / len(z) == pytest.approx(second, abs=0.06)


def test_every_component_has_its_share_of_the_draws():
    apart = MixtureProposal(
        np.array([0.05, 0.95]),
        (make_round_component(np.array([-50.0])), make_round_component(np.array([50.0]))),
        1,
    )
    z = apart.draw(60, np.random.default_rng(3))
    assert np.count_nonzero(z < 0.0) == 3


def test_a_fit_finds_the_groups_of_a_sample_and_no_more():
    random = np.random.default_rng(4)
    means = np.array([[4.0, 0.0, 0.0, 0.0], [-4.0, 0.0, 0.0, 0.0], [0.0, 4.0, 0.0, 0.0]])
    sizes = [40, 20, 20]
    z = np.concatenate(
        [random.normal(mean, 1.0, (n, 4)) for mean, n in zip(means, sizes, strict=True)]
    )
    found = fit_mixture(z, np.ones(80), 8, (), random)
    order = np.argsort(-found.shares)
    assert len(found.shares) == 3
    assert found.shares[order][0] == pytest.approx(0.5, abs=0.02)
    centres = np.stack([component.mean for component in found.components])
    for mean in means:
        assert np.linalg.norm(centres - mean, axis=1).min() < 1.0


def test_a_fit_to_one_normal_has_one_component():
    random = np.random.default_rng(5)
    z = random.normal([3.0, 0.0, 0.0], 1.0, (100, 3))
    assert len(fit_mixture(z, np.ones(100), 6, (), random).shares) == 1


def test_weights_are_those_of_repeated_samples():
    random = np.random.default_rng(6)
    z = np.concatenate([random.normal(5.0, 1.0, (30, 2)), random.normal(-5.0, 1.0, (30, 2))])
    weights = np.repeat([3.0, 1.0], 30)
    found = fit_mixture(z, weights, 4, (), random)
    right = sum(
        share
        for share, component in zip(found.shares, found.components, strict=True)
        if component.mean[0] > 0.0
    )
    assert right == pytest.approx(0.75, abs=0.01)


def test_the_variance_of_a_component_stays_within_its_bounds():
    random = np.random.default_rng(7)
    z = random.normal(0.0, [0.05, 5.0], (400, 2)) + np.array([4.0, 0.0])
    found = fit_mixture(z, np.ones(400), 1, (), random).components[0]
    assert found.variances == pytest.approx([NARROWEST, WIDEST])


def test_few_samples_are_shrunk_to_the_prior():
    random = np.random.default_rng(8)
    z = random.normal(0.0, 1.0, (12, 40))
    component = fit_mixture(z, np.ones(12), 1, (), random).components[0]
    assert np.linalg.norm(component.mean) < 0.5 * np.linalg.norm(z.mean(axis=0))
    assert (component.variances == 1.0).all()


def test_a_broad_component_keeps_its_least_share_and_its_place():
    random = np.random.default_rng(9)
    broad = make_prior_proposal(2).components + make_scaled_proposal(2, 3.0).components
    z = random.normal([8.0, 0.0], 1.0, (60, 2))
    found = fit_mixture(z, np.ones(60), 2, broad, random)
    assert found.broad == 2
    assert found.shares[:2] == pytest.approx(LEAST_BROAD_SHARE / 1.1, rel=0.01)
    assert found.components[1].variances == pytest.approx(9.0)


def test_a_joined_mixture_has_the_share_of_the_other_one():
    first = add_broad_components(
        MixtureProposal(np.array([0.8, 0.2]), MIXTURE.components[1:], 0),
        make_prior_proposal(2).components,
    )
    joined = MIXTURE.join(first, 0.25)
    assert joined.shares.sum() == pytest.approx(1.0)
    assert joined.shares[-2:] == pytest.approx([0.2, 0.05])
    assert first.even_out().shares[1:] == pytest.approx([0.6175, 0.3325])
