"""Minimal failures: exactly what is needed is left, of toys that say what that is."""

import numpy as np
import pytest

from eigenfail.errors import InvalidValue, LearnerFailed
from eigenfail.settings import read_settings
from eigenfail.values.episode import EpisodeFault, unrunnable
from eigenfail.values.learning import LearnerContext
from eigenfail_services.campaigns.rounds import Rounds, run_in_process
from eigenfail_services.methods import minimal_search
from eigenfail_services.methods.minimal import Minimal, read_state
from eigenfail_services.methods.minimal_search import RESOLUTION, SearchPhase

STEPS = 60
NEEDED = ((10, 0), (11, 0), (37, 0))
LEVEL = 1.0


def noise(seed=0, level=2.0):
    """Noise that is strong enough wherever the toy asks for it."""
    z = np.random.default_rng(seed).standard_normal((STEPS, 2)).astype(np.float32)
    for place in NEEDED:
        z[place] = level
    return z


def all_needed(z):
    """Fails where every one of three steps of one axis is pushed by `LEVEL` or more."""
    return LEVEL - np.min([z[:, step, axis] for step, axis in NEEDED], axis=0)


def learner_of(z, **settings):
    context = LearnerContext(0, 10_000, len(z), np.asarray(z, np.float32)[None])
    return Minimal(context, read_settings(Minimal.Settings, settings, "settings"))


@pytest.fixture
def shrink(noise_engine):
    """Runs a campaign; its results, and what its learner knew in the end."""

    def run(z, robustness, episodes=5_000, broken=None, **settings):
        learner = learner_of(z, **settings)
        rounds = Rounds(learner, 0, episodes)
        results = list(run_in_process(rounds, noise_engine(robustness, broken)))
        return results, read_state(learner.state())

    return run


@pytest.mark.parametrize("seed", range(4))
def test_what_is_needed_is_left_and_nothing_else(shrink, seed):
    results, (facts, z) = shrink(noise(seed), all_needed)
    assert facts.phase is SearchPhase.OVER
    assert {tuple(place) for place in np.argwhere(z).tolist()} == set(NEEDED)
    weakest = float(z[NEEDED[0]])
    assert LEVEL <= weakest <= LEVEL + 2.0 * RESOLUTION
    best = results[facts.best]
    assert best.is_failure
    np.testing.assert_array_equal(best.noise.z, z)
    assert minimal_search.compute_energy(best.noise.z) == pytest.approx(3 * weakest**2)
    likeliest = max((r for r in results if r.is_failure), key=lambda r: r.noise.log_probability)
    assert likeliest.index == best.index
    assert len(results) < 400


def test_one_axis_that_plays_no_part_goes_in_the_first_rounds(shrink):
    results, _ = shrink(noise(), all_needed)
    assert not results[2].noise.z[:, 1].any()
    assert results[2].is_failure
    assert not results[1].is_failure


def test_either_of_two_causes_will_do(shrink):
    def either(z):
        return LEVEL - np.maximum(z[:, 20, 0], z[:, 50, 1])

    z = noise()
    z[20, 0], z[50, 1] = 3.0, 2.0
    _, (facts, found) = shrink(z, either)
    assert facts.phase is SearchPhase.OVER
    assert np.count_nonzero(found) == 1


def test_a_planner_that_fails_undisturbed_needs_no_noise(shrink):
    results, (facts, z) = shrink(noise(), lambda z: -np.ones(len(z)))
    assert facts.phase is SearchPhase.OVER
    assert not z.any()
    assert not results[facts.best].noise.z.any()


def test_a_sum_is_shrunk_to_steps_none_of_which_can_go(shrink):
    """Where any steps do, as long as they are enough: 1-minimal, and as weak as it may be."""

    def enough(z):
        return 12.0 - z[:, 20:40, 0].sum(axis=1)

    z = np.full((STEPS, 2), 1.5, np.float32)
    _, (facts, found) = shrink(z, enough)
    assert facts.phase is SearchPhase.OVER
    assert not found[:, 1].any()
    assert not found[:20].any()
    assert not found[40:].any()
    assert 12.0 <= found.sum() <= 12.0 + 12.0 * 2 * RESOLUTION
    for mask in minimal_search.make_blocks(found, 1):
        assert enough(minimal_search.remove_block(found, mask)[None])[0] > 0.0
    assert enough(found[None] * (1.0 - 2.0 * RESOLUTION))[0] > 0.0


@pytest.mark.parametrize("seed", [198, 767, 2984])
def test_what_is_told_was_shown_to_be_minimal_though_another_replay_had_less(shrink, seed):
    """Any of three causes will do; with these seeds the search passes by the weakest."""
    rng = np.random.default_rng(seed)
    z = rng.normal(size=(6, 2)) * rng.choice([0.3, 3.0], size=(6, 2))
    causes = [rng.choice(12, size=rng.integers(1, 5), replace=False) for _ in range(3)]
    strong = np.abs(np.float32(z)).reshape(-1) * np.float32(0.999)

    def any_cause(tried):
        there = np.abs(tried.reshape(len(tried), -1)) >= strong
        failing = [there.all(axis=1), *(there[:, cause].all(axis=1) for cause in causes)]
        return np.where(np.any(failing, axis=0), -1.0, 1.0)

    results, (facts, found) = shrink(z, any_cause)
    told = results[facts.best].noise.z
    assert facts.phase is SearchPhase.OVER
    np.testing.assert_array_equal(told, found)
    for mask in minimal_search.make_blocks(told, 1):
        assert any_cause(minimal_search.remove_block(told, mask)[None])[0] > 0.0
    least = min(
        minimal_search.compute_energy(result.noise.z) for result in results if result.is_failure
    )
    assert least < minimal_search.compute_energy(told)


def test_a_failure_that_is_none_is_refused_with_what_to_do(shrink):
    with pytest.raises(LearnerFailed, match=r"does not reproduce at full strength.*own campaign"):
        shrink(noise(level=0.5), all_needed)


def test_a_failure_that_could_not_be_run_is_tried_again(noise_engine):
    learner = learner_of(noise())
    (source,) = learner.propose(10).sources
    from eigenfail.values.episode import EpisodeTask

    task = EpisodeTask(0, 0, source)
    learner.observe([unrunnable(task, EpisodeFault("simulator", "test"))])
    (again,) = learner.propose(10).sources
    np.testing.assert_array_equal(again.z, source.z)


def test_the_budget_may_end_it_at_any_point_with_what_there_is(shrink):
    whole, (last, _) = shrink(noise(), all_needed)
    whole_energy = minimal_search.compute_energy(whole[last.best].noise.z)
    energies = []
    for episodes in (1, 2, 7, 40, len(whole) - 1):
        results, (facts, _) = shrink(noise(), all_needed, episodes=episodes)
        assert len(results) == episodes
        assert facts.phase is not SearchPhase.OVER
        assert [r.digest() for r in results] == [r.digest() for r in whole[:episodes]]
        assert results[facts.best].is_failure
        energies.append(minimal_search.compute_energy(results[facts.best].noise.z))
    assert energies == sorted(energies, reverse=True)
    assert energies[-1] >= whole_energy


@pytest.mark.parametrize("round_size", [1, 7, 500])
def test_the_size_of_rounds_changes_nothing(shrink, round_size):
    results, (facts, z) = shrink(noise(), all_needed, round_size=round_size)
    whole, (expected, wanted) = shrink(noise(), all_needed)
    assert [r.digest() for r in results] == [r.digest() for r in whole]
    assert (facts.best, z.tobytes()) == (expected.best, wanted.tobytes())


def test_replays_that_could_not_be_run_are_counted_not_believed(shrink):
    def broken(z):
        return (np.count_nonzero(z, axis=(1, 2)) == 2) & (z[:, 10, 0] == 0.0)

    _, (facts, z) = shrink(noise(), all_needed, broken=broken)
    assert facts.phase is SearchPhase.OVER
    assert np.count_nonzero(z) == 3
    assert facts.not_run == 1


def test_exactly_one_failure_is_shrunk():
    for count in (0, 2):
        context = LearnerContext(0, 10, 4, np.ones((count, 4, 2), np.float32))
        with pytest.raises(InvalidValue, match=f"they name {count} failures"):
            Minimal(context, Minimal.Settings())


@pytest.mark.parametrize("channels", [1, 3, 5])
def test_each_channel_has_blocks_of_its_own(channels):
    found = minimal_search.make_blocks(np.ones((7, channels), np.float32), 4)
    assert [np.argwhere(mask)[0].tolist() for mask in found] == [
        [first, channel] for channel in range(channels) for first in (3, 0)
    ]
    assert sum(mask.astype(int) for mask in found).tolist() == [[1] * channels] * 7


def test_blocks_cover_the_noise_once_from_the_end_on():
    z = np.zeros((7, 2), np.float32)
    z[1:, 0] = 1.0
    found = minimal_search.make_blocks(z, 3)
    assert [np.flatnonzero(mask[:, 0]).tolist() for mask in found] == [[4, 5, 6], [1, 2, 3]]
    assert not any(mask[:, 1].any() for mask in found)
    np.testing.assert_array_equal(
        minimal_search.keep_block(z, found[0]) + minimal_search.keep_block(z, found[1]), z
    )
    np.testing.assert_array_equal(
        minimal_search.remove_block(z, found[0]), minimal_search.keep_block(z, found[1])
    )


@pytest.mark.parametrize("count", [2, 3, 8, 100])
def test_unions_begin_with_all_blocks_and_end_with_few(count):
    z = np.random.default_rng(count).standard_normal((count, 2)).astype(np.float32)
    z[:, 1] = 0.0
    every = minimal_search.make_blocks(z, 1)
    sizes = [int(union.sum()) for union in minimal_search.list_unions(z, every)]
    assert sizes[0] == count
    assert min(sizes) == max(2, -(-count // 8))
    assert len(sizes) < 16
