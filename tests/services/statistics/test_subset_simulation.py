"""Subset simulation against probabilities in closed form."""

from math import exp, log, prod, sqrt
from statistics import NormalDist

import numpy as np
import pytest
from msgspec import structs

from eigenfail.errors import InvalidValue
from eigenfail_services.statistics.intervals import Z
from eigenfail_services.statistics.subset_simulation import (
    ConditionalSampler,
    SubsetEnd,
    SubsetSettings,
    _estimate_variation,
    _find_next_threshold,
    combine_variations,
    estimate_lineage_variation,
    subset_simulation,
)

STEPS = 20
SETTINGS = SubsetSettings(samples=1000)


def half_space(p):
    """Distance to a plane through the noise beyond which lies a share p of all noise."""
    reach = -NormalDist().inv_cdf(p)
    return lambda z: reach - z.reshape(len(z), -1).sum(axis=1) / sqrt(z[0].size)


def two_modes(z):
    """max(3 − min(|x1|, x2), 0): fails in two corners, P = 2·Q(3)²."""
    x1, x2 = z[:, 0, 0], z[:, 0, 1]
    return np.maximum(3.0 - np.minimum(np.abs(x1), x2), 0.0)


def rounded(robustness, grain):
    """Robustness that is known to the next multiple of a grain only."""
    return lambda z: np.ceil(robustness(z) / grain) * grain


def played(dialogue, robustness):
    """What a dialogue over noise and robustness comes to."""
    z = next(dialogue)
    while True:
        try:
            z = dialogue.send(robustness(z))
        except StopIteration as end:
            return end.value


def held(robustness, p, steps=STEPS, settings=SETTINGS, runs=20):
    """In how many of some runs the interval holds p, and the mean estimate ÷ p."""
    found = [subset_simulation(robustness, steps, settings, seed) for seed in range(runs)]
    assert {one.end for one in found} == {SubsetEnd.REACHED}
    inside = [one.interval.low <= p <= one.interval.high for one in found]
    return sum(inside), float(np.mean([one.probability for one in found])) / p


@pytest.mark.parametrize("p", [0.2, 1e-3, 1e-5])
def test_a_half_space_lies_in_its_interval(p):
    inside, ratio = held(half_space(p), p)
    assert inside >= 17
    assert ratio == pytest.approx(1.0, abs=0.25)


def test_both_modes_are_found_and_counted():
    p = 2.0 * NormalDist().cdf(-3.0) ** 2
    inside, ratio = held(two_modes, p, steps=1, settings=structs.replace(SETTINGS, samples=2000))
    assert inside >= 17
    assert ratio == pytest.approx(1.0, abs=0.25)


def test_ties_do_not_shift_the_estimate():
    inside, ratio = held(rounded(half_space(1e-5), 1.0), 1e-5)
    assert inside >= 17
    assert ratio == pytest.approx(1.0, abs=0.3)


def test_an_estimate_is_the_product_of_its_levels_and_says_what_it_cost():
    calls = []
    far = half_space(1e-5)
    found = subset_simulation(lambda z: (calls.append(len(z)), far(z))[1], STEPS, SETTINGS, 3)
    thresholds = [level.threshold for level in found.levels]
    assert thresholds == sorted(set(thresholds), reverse=True)
    assert thresholds[-1] == 0.0
    assert [level.share for level in found.levels[:-1]] == [0.1] * (len(thresholds) - 1)
    assert found.probability == pytest.approx(prod(level.share for level in found.levels))
    assert combine_variations(found.levels) <= found.variation < 1.0
    assert 5 < found.ancestors < 100
    width = log(found.interval.high / found.interval.low)
    assert width == pytest.approx(2.0 * Z * sqrt(log(1.0 + found.variation**2)))
    assert sqrt(found.interval.low * found.interval.high) == pytest.approx(found.probability)
    assert found.evaluations == sum(calls) == 1000 + 900 * (len(thresholds) - 1)


def test_two_fifths_of_the_moves_are_accepted():
    levels = subset_simulation(half_space(1e-6), STEPS, SETTINGS, 1).levels
    assert all(0.3 <= level.acceptance <= 0.5 for level in levels[1:])
    bold = structs.replace(SETTINGS, acceptance=0.2)
    levels = subset_simulation(half_space(1e-6), STEPS, bold, 1).levels
    assert all(0.1 <= level.acceptance <= 0.3 for level in levels[2:])


def test_the_same_seed_gives_the_same_estimate():
    first, again, other = (
        subset_simulation(half_space(1e-4), STEPS, SETTINGS, seed) for seed in (8, 8, 9)
    )
    assert first == again
    assert first.probability != other.probability


@pytest.mark.parametrize(
    ("robustness", "end"),
    [
        (lambda z: np.full(len(z), 3.0), SubsetEnd.STALLED),
        (lambda z: np.maximum(half_space(1e-5)(z), 1.0), SubsetEnd.STALLED),
        (lambda z: 1.0 + np.exp(half_space(1e-3)(z)), SubsetEnd.SPENT),
    ],
)
def test_where_failures_are_out_of_reach_it_ends_and_says_so(robustness, end):
    settings = SubsetSettings(samples=200, most_levels=8)
    found = subset_simulation(robustness, STEPS, settings, 1)
    assert found.end is end
    assert (found.probability, found.interval, found.ancestors) == (None, None, 0)
    assert len(found.levels) <= 8
    assert all(level.threshold > 0.0 for level in found.levels)


@pytest.mark.parametrize(
    ("values", "before", "threshold"),
    [
        ([5.0, 1.0, 4.0, 3.0, 2.0], 9.0, 1.0),
        ([5.0, -1.0, 4.0, 3.0, 2.0], 9.0, 0.0),
        ([2.0, 2.0, 2.0, 2.0, 2.0], 9.0, 2.0),
        ([2.0, 2.0, 2.0, 2.0, 2.0], 2.0, None),
        ([2.0, 1.0, 2.0, 2.0, 2.0], 2.0, 1.0),
    ],
)
def test_levels_fall_or_there_is_none(values, before, threshold):
    assert _find_next_threshold(np.array(values), before, 0.2) == threshold
    if threshold == 1.0:
        assert _find_next_threshold(np.array(values * 2 + [2.0] * 10), 2.0, 0.2) == threshold


def test_the_variation_of_independent_draws_is_the_binomial_one():
    inside = np.arange(1000)[None] < 100
    assert _estimate_variation(inside) == pytest.approx(sqrt(0.9 / 100.0))


def test_chains_that_never_move_are_worth_one_sample_each():
    inside = np.tile(np.arange(100) < 10, (10, 1))
    assert _estimate_variation(inside) == pytest.approx(sqrt(0.9 / 10.0))


def test_an_estimate_is_as_sure_as_the_failures_have_ancestors():
    assert estimate_lineage_variation(np.array([0.0, 7.0, 0.0])) == 1.0
    assert estimate_lineage_variation(np.array([2.0, 2.0, 0.0, 2.0, 2.0])) == 0.5
    assert estimate_lineage_variation(np.array([3.0, 4.0])) == pytest.approx(5.0 / 7.0)


def test_the_variation_that_is_said_is_the_one_that_is():
    found = [subset_simulation(half_space(1e-5), STEPS, SETTINGS, seed) for seed in range(100)]
    truth = np.std([one.probability for one in found]) / 1e-5
    assert np.mean([one.variation for one in found]) == pytest.approx(truth, rel=0.2)


def test_samples_of_a_level_are_distributed_as_the_noise_below_it():
    """Of the half space beyond 2 sigma: mean phi(2)/Q(2) along its normal, nothing across it."""
    sampler = ConditionalSampler(np.random.default_rng(2), acceptance=0.4)
    first = played(sampler.independent(20_000, 2), half_space(0.5))
    chains = played(sampler.below(-2.0, first, 400), half_space(0.5))
    z = chains.z.reshape(-1, 4)
    assert chains.z.shape[2:] == (2, 2)
    assert (chains.values <= -2.0).all()
    expected = exp(-2.0) / sqrt(2.0 * np.pi) / NormalDist().cdf(-2.0)
    assert z.sum(axis=1).mean() / 2.0 == pytest.approx(expected, abs=0.02)
    across = z @ np.array([0.5, -0.5, 0.5, -0.5])
    assert across.mean() == pytest.approx(0.0, abs=0.1)
    assert across.std() == pytest.approx(1.0, abs=0.06)


@pytest.mark.parametrize(
    "broken", [lambda z: np.full(len(z), np.nan), lambda z: np.zeros(len(z) + 1), lambda z: 1.0]
)
def test_what_is_no_robustness_is_refused(broken):
    with pytest.raises(InvalidValue, match="one finite number for each trajectory"):
        subset_simulation(broken, STEPS, SETTINGS, 1)
