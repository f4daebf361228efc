"""Chains of failures, against p(z | failure) of half spaces."""

from collections import Counter, deque
from math import exp, pi, sqrt
from statistics import NormalDist

import numpy as np
import pytest

from eigenfail_searches.chains.sampler import (
    MOVES,
    ChainSampler,
    MoveKind,
    MoveMix,
    redraw_detail,
    redraw_sums,
    redraw_window,
    shift_segment,
)

STEPS, BETA = 5, 2.0
DIRECTION = np.ones((STEPS, 2)) / sqrt(2 * STEPS)
TAIL_MEAN = exp(-(BETA**2) / 2) / sqrt(2 * pi) / NormalDist().cdf(-BETA)
"""Mean of N(0, 1) beyond BETA; its second moment is 1 + BETA · TAIL_MEAN."""


def mix_of(*kinds, adapted=0):
    weights = {kind: float(kind in kinds) for kind in MoveKind}
    return MoveMix(weights=weights, acceptance=0.4, adapted=adapted)


def along(z):
    return np.sum(z * DIRECTION, axis=(1, 2))


def sample(mix, chains=60, moves=500, burn_in=100, parallel=None):
    """States of chains in the half space z·w >= BETA, shape (draws, chains, steps, 2)."""
    starts = np.tile((3.0 * DIRECTION).astype(np.float32), (chains, 1, 1))
    ends = np.full(chains, STEPS)
    sampler = ChainSampler(starts, ends.copy(), mix, 7, parallel)
    states, waiting = [], deque[np.ndarray]()
    while sampler.moved < moves:
        while len(waiting) < len(sampler.groups):
            waiting.append(sampler.propose(chains))
        before, z = sampler.moved, waiting.popleft()
        sampler.accept(z, ends[: len(z)], along(z) >= BETA, np.ones(len(z), bool))
        if sampler.moved > before:
            states.append(sampler.z.copy())
    return np.stack(states[burn_in:]), sampler


@pytest.mark.parametrize(
    "kinds",
    [
        (MoveKind.REDRAW,),
        (MoveKind.WINDOW,),
        (MoveKind.PCN,),
        (MoveKind.REDRAW, MoveKind.SHIFT),
        (MoveKind.REDRAW, MoveKind.SMOOTH),
        (MoveKind.SMOOTH, MoveKind.DETAIL),
        tuple(MoveKind),
    ],
)
def test_samples_of_a_half_space_are_a_truncated_normal(kinds):
    check_truncated_normal(sample(mix_of(*kinds, adapted=100))[0])


def test_chains_that_move_in_groups_have_the_same_distribution():
    states, sampler = sample(mix_of(*MoveKind, adapted=100), parallel=40)
    assert [len(group) for group in sampler.groups] == [10] * 6
    check_truncated_normal(states)


def check_truncated_normal(states):
    z = states.reshape(-1, STEPS, 2).astype(np.float64)
    normal = along(z)
    assert normal.min() >= BETA - 1e-5
    assert normal.mean() == pytest.approx(TAIL_MEAN, abs=0.03)
    assert normal.var() == pytest.approx(1 + BETA * TAIL_MEAN - TAIL_MEAN**2, rel=0.12)
    square = np.square(z).sum(axis=(1, 2))
    assert square.mean() == pytest.approx(2 * STEPS - 1 + 1 + BETA * TAIL_MEAN, rel=0.03)


@pytest.mark.parametrize("kind", MoveKind)
@pytest.mark.parametrize("size", [0.05, 0.5, 1.0])
def test_each_move_leaves_the_prior_unchanged(kind, size):
    rng = np.random.default_rng(1)
    z = rng.standard_normal((3000, 20, 2))
    moved = np.stack([MOVES[kind](each, size, rng) for each in z])
    assert moved.mean(axis=0) == pytest.approx(0.0, abs=0.09)
    assert moved.var(axis=0) == pytest.approx(1.0, abs=0.14)
    # Reversible: the covariance of before and after is symmetric, and no step is left out.
    before, after = z.reshape(len(z), -1), moved.reshape(len(z), -1)
    crossed = before.T @ after / len(z)
    assert crossed == pytest.approx(crossed.T, abs=0.12)
    assert (before != after).any(axis=0).all()


@pytest.mark.parametrize("channels", [1, 3, 5])
@pytest.mark.parametrize("kind", MoveKind)
def test_each_move_reaches_every_channel_and_leaves_the_prior_unchanged(kind, channels):
    rng = np.random.default_rng(1)
    z = rng.standard_normal((3000, 20, channels))
    moved = np.stack([MOVES[kind](each, 0.5, rng) for each in z])
    assert moved.mean(axis=0) == pytest.approx(0.0, abs=0.09)
    assert moved.var(axis=0) == pytest.approx(1.0, abs=0.14)
    assert (moved != z).any(axis=0).all()


@pytest.mark.parametrize("channels", [1, 2, 3, 5])
@pytest.mark.parametrize("move", [redraw_window, shift_segment])
def test_one_channel_is_moved_or_all_each_as_often(move, channels):
    rng = np.random.default_rng(3)
    before = rng.standard_normal((60, channels))
    moved = Counter(
        tuple((move(before, 0.0, rng) != before).any(axis=0).tolist()) for _ in range(3000)
    )
    alone = {tuple(row) for row in np.eye(channels, dtype=bool).tolist()}
    assert set(moved) == alone | {(True,) * channels}
    if channels > 1:
        assert min(moved.values()) == pytest.approx(3000 / (1 + channels), rel=0.15)


def test_a_window_has_3_to_15_steps_and_reaches_every_step_as_often():
    rng = np.random.default_rng(2)
    changed = np.stack([redraw_window(np.zeros((60, 2)), 0.0, rng) != 0 for _ in range(4000)])
    widths = changed[..., 0].sum(axis=1)
    assert widths.max() == 15
    assert changed.mean(axis=(0, 2)) == pytest.approx(changed.mean(), rel=0.2)


def test_a_shift_moves_a_segment_by_at_most_10_steps_and_never_leaves_all_in_place():
    rng = np.random.default_rng(4)
    before = np.arange(120.0).reshape(60, 2)
    reached = set()
    for _ in range(2000):
        after = shift_segment(before, 0.0, rng)
        changed = np.flatnonzero((after != before).any(axis=1))
        assert changed.size >= 2
        segment = slice(changed[0], changed[-1] + 1)
        for was, now in zip(before[segment].T, after[segment].T, strict=True):
            turns = [by for by in range(-10, 11) if (np.roll(was, by) == now).all()]
            assert turns
            reached |= set(turns)
    assert reached == set(range(-10, 11))


def test_redrawn_sums_are_smooth_and_reach_every_step_of_each_axis():
    rng = np.random.default_rng(5)
    changes = np.stack([redraw_sums(np.zeros((60, 2)), 0.0, rng) for _ in range(4000)])
    assert np.square(changes).sum(axis=(1, 2)).mean() == pytest.approx(3.0, rel=0.1)
    assert (changes != 0).mean(axis=0) == pytest.approx(0.22, abs=0.12)
    # Successive changes differ little: nearly all of the change is below a tenth of the rate.
    spectrum = np.square(np.abs(np.fft.rfft(changes, axis=1))).mean(axis=(0, 2))
    assert spectrum[7:].sum() < 0.25 * spectrum.sum()


def test_redrawn_detail_keeps_mean_and_trend_of_a_window():
    rng = np.random.default_rng(6)
    before = rng.standard_normal((60, 2))
    ramp = np.arange(60.0)
    for _ in range(500):
        change = redraw_detail(before, 0.0, rng) - before
        rows = np.flatnonzero(change.any(axis=1))
        assert 3 <= len(rows) <= 50
        assert rows[-1] - rows[0] == len(rows) - 1
        assert change.sum(axis=0) == pytest.approx(0.0, abs=1e-9)
        assert ramp @ change == pytest.approx(0.0, abs=1e-8)


@pytest.mark.parametrize("steps", [1, 2])
def test_noise_without_detail_is_redrawn(steps):
    z = np.ones((steps, 2))
    rng = np.random.default_rng(1)
    assert any((redraw_detail(z, 0.0, rng) != z).any() for _ in range(5))


def find_pulses(z, length=4):
    """Step at which the largest sum of successive values of the first axis begins, and that sum."""
    sums = np.lib.stride_tricks.sliding_window_view(z[..., 0], length, axis=1).sum(axis=2)
    return sums.argmax(axis=1), sums.max(axis=1) / sqrt(length)


def share_of_late_pulses(*kinds):
    """Share of late ones in the end where a pulse at any step fails and all chains start early."""
    starts = np.zeros((60, 40, 2), np.float32)
    starts[:, 3:7, 0] = 2.5
    ends, all_ran = np.full(60, 40), np.ones(60, bool)
    sampler = ChainSampler(starts, ends.copy(), mix_of(*kinds, adapted=100), seed=9)
    for _ in range(500):
        z = sampler.propose(60)
        sampler.accept(z, ends, find_pulses(z)[1] >= 4.5, all_ran)
    return float((find_pulses(sampler.z)[0] > 18).mean())


def test_shifts_reach_failures_at_another_time():
    assert share_of_late_pulses(MoveKind.REDRAW) < 0.1
    assert share_of_late_pulses(MoveKind.REDRAW, MoveKind.SHIFT) == pytest.approx(0.5, abs=0.2)


def test_noise_of_a_single_step_is_redrawn_rather_than_shifted():
    z = np.ones((1, 2))
    assert (shift_segment(z, 0.0, np.random.default_rng(1)) != z).any()


def test_noise_after_the_failure_is_drawn_anew():
    starts = np.full((4, 10, 2), 2.0, np.float32)
    sampler = ChainSampler(starts, np.full(4, 6), mix_of(MoveKind.PCN), seed=3)
    sampler.sizes[MoveKind.PCN] = 0.0
    proposed = sampler.propose(4)
    assert (proposed[:, :6] == 2.0).all()
    assert abs(proposed[:, 6:].mean()) < 0.5


def test_sizes_follow_the_acceptance_and_then_stay():
    states, sampler = sample(mix_of(MoveKind.PCN, adapted=150), moves=300, burn_in=150)
    accepted = (states[1:] != states[:-1]).any(axis=(2, 3)).mean()
    assert accepted == pytest.approx(0.4, abs=0.08)
    frozen = dict(sampler.sizes)
    z = sampler.propose(60)
    sampler.accept(z, np.full(60, STEPS), np.zeros(60, bool), np.ones(60, bool))
    assert sampler.sizes == frozen


def test_sizes_of_groups_stay_from_the_first_move_on_that_is_a_sample():
    starts, moves = np.tile((3.0 * DIRECTION).astype(np.float32), (12, 1, 1)), 4
    sampler = ChainSampler(starts, np.full(12, STEPS), mix_of(MoveKind.PCN, adapted=moves), 7, 12)
    count = len(sampler.groups)
    assert count == 3
    sizes = []
    for _ in range(count * (moves + 2)):
        z = sampler.propose(12)
        sizes.append(sampler.sizes[MoveKind.PCN])
        sampler.accept(z, np.full(len(z), STEPS), np.ones(len(z), bool), np.ones(len(z), bool))
    assert len(set(sizes[: count * (moves - 1) + 1])) == count * (moves - 1) + 1
    assert len(set(sizes[count * (moves - 1) + 1 :])) == 1


def test_a_chain_whose_move_does_not_fail_or_is_not_run_stays():
    starts = np.arange(3 * 4 * 2, dtype=np.float32).reshape(3, 4, 2)
    sampler = ChainSampler(starts.copy(), np.full(3, 4), mix_of(MoveKind.PCN, adapted=9), seed=1)
    size = sampler.sizes[MoveKind.PCN]
    z, nothing = sampler.propose(3), np.zeros(3, bool)
    sampler.accept(z, np.full(3, 4), nothing, nothing)
    assert (sampler.z == starts).all()
    assert sampler.sizes[MoveKind.PCN] == size
    moved = np.array([False, True, False])
    z = sampler.propose(3)
    sampler.accept(z, np.array([4, 3, 4]), moved, np.ones(3, bool))
    assert (sampler.z[moved] == z[moved]).all()
    assert (sampler.z[~moved] == starts[~moved]).all()
    assert sampler.ends.tolist() == [4, 3, 4]
