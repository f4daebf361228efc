"""The network of DiFS and what it learns, moved samples, and failures in several regions."""

from statistics import NormalDist

import numpy as np
import pytest
from difs_learners import make_difs, noise_of

from eigenfail.functions import of_batch
from eigenfail.values.episode import EpisodeTask, PriorSource
from eigenfail_services.campaigns.rounds import Rounds, run_in_process
from eigenfail_services.methods import archive
from eigenfail_services.methods.difs.method import (
    DiffusionFailureSampling,
    prefer_likely,
    weigh_elite,
)
from eigenfail_services.methods.difs.model import ConditionalDiffusion
from eigenfail_services.methods.difs.settings import DifsSettings, LabelledNoise
from eigenfail_services.methods.trials import compute_excess, move
from eigenfail_workers.functions import FunctionEngine

STEPS, NORMAL = 40, NormalDist()


def make_model(**settings):
    given = {"width": 24, "jitter": 0, "device": "cpu", "ema": 0.98, **settings}
    return ConditionalDiffusion(DifsSettings(**given), STEPS, 2, seed=0)


def make_examples(z, condition=None, excess=None, **changes):
    count = len(z)
    nothing = np.zeros(count, np.float32)
    given = {
        "z": np.asarray(z, np.float32),
        "unseen": np.zeros(z.shape[:2], bool),
        "condition": nothing if condition is None else condition,
        "excess": nothing if excess is None else excess,
        "weights": np.full(count, 1.0 / count),
    }
    return LabelledNoise(**given | changes)


def train(model, examples, steps, elite_share=0.5):
    model.train(examples, steps, elite_share, draw=1)


def sample_mean(model):
    """The mean of samples at robustness 0, shape (steps, channels)."""
    return model.sample(np.zeros(1000, np.float32), 0.0, draw=2).mean(axis=0)


@pytest.mark.parametrize(("share", "low", "high"), [(0.0, 0.3, 0.7), (1.0, 0.8, 1.2)])
def test_a_batch_has_its_share_of_the_elite(share, low, high):
    """Half of the trajectories are around 1, and are the elite; the others are around 0."""
    elite = np.arange(200) < 100
    z = np.random.default_rng(0).standard_normal((200, STEPS, 2)) + elite[:, None, None]
    model = make_model()
    train(model, make_examples(z, weights=elite / 100.0), 300, share)
    assert low < sample_mean(model).mean() < high


def test_steps_behind_the_end_of_an_episode_are_learnt_as_draws_from_the_prior():
    z = np.random.default_rng(0).standard_normal((200, STEPS, 2))
    z[:, 20:] = 3.0
    unseen = np.tile(np.arange(STEPS) >= 20, (200, 1))
    model = make_model()
    train(model, make_examples(z, unseen=unseen), 300)
    samples = model.sample(np.zeros(1000, np.float32), 0.0, draw=2)[:, 20:]
    assert abs(samples.mean()) < 0.2
    assert samples.std() == pytest.approx(1.0, abs=0.1)


def test_a_push_is_learnt_at_neighbouring_steps_too():
    z = np.random.default_rng(0).standard_normal((300, STEPS, 2))
    z[:, 18:22, 0] += 3.0
    pushed = []
    for jitter in (0, 2):
        model = make_model(jitter=jitter)
        train(model, make_examples(z), 500)
        pushed.append(sample_mean(model)[:, 0])
    # Shifted by up to two steps, a push of four steps has a fifth of its height two steps away.
    assert pushed[1][[16, 23]].mean() > pushed[0][[16, 23]].mean() + 0.25


def test_excess_counts_injected_values_alone():
    z = np.ones((3, STEPS, 2), np.float32)
    z[1] *= 2.0
    unseen = np.zeros((3, STEPS), bool)
    unseen[2, 10:] = True
    z[2, 10:] = 50.0
    # Of 80 values with z² = 4: (320 - 80) / sqrt(160).
    np.testing.assert_allclose(compute_excess(z, unseen), [0.0, 240.0 / 160**0.5, 0.0], rtol=1e-6)


def test_excess_is_standardised_under_the_prior():
    z = np.random.default_rng(0).standard_normal((4000, STEPS, 2)).astype(np.float32)
    excess = compute_excess(z, np.zeros((4000, STEPS), bool))
    assert abs(excess.mean()) < 0.06
    assert abs(excess.std() - 1.0) < 0.05


def test_untrained_network_samples_the_prior():
    z = make_model().sample(np.zeros(2000, np.float32), 0.0, draw=1).reshape(2000, -1)
    assert np.abs(z.mean(axis=0)).max() < 0.1
    assert abs(z.std() - 1.0) < 0.01


def test_network_learns_how_noise_depends_on_robustness():
    random = np.random.default_rng(0)
    z = random.standard_normal((200, STEPS, 2))
    z[:100, :10, 0] += 2.0
    condition = np.repeat([0.0, 1.0], 100).astype(np.float32)
    model = make_model()
    train(model, make_examples(z, condition), 400)
    near, far = (
        model.sample(np.full(500, at, np.float32), 0.0, draw=2)[:, :10, 0].mean() for at in (0, 1)
    )
    assert near > 1.2
    assert abs(far) < 0.4


def test_network_asked_for_less_excess_samples_likelier_noise():
    random = np.random.default_rng(0)
    z = random.standard_normal((400, STEPS, 2)) * np.repeat([1.0, 1.6], 200)[:, None, None]
    excess = compute_excess(z.astype(np.float32), np.zeros((400, STEPS), bool))
    model = make_model()
    train(model, make_examples(z, excess=excess), 400)
    little, much = (
        (model.sample(np.zeros(300, np.float32), wanted, draw=2) ** 2).mean()
        for wanted in (0.0, float(excess[200:].mean()))
    )
    assert little < 1.3
    assert much > 1.7


def test_network_learns_a_mean_that_varies_slowly_in_time():
    """A push of 0.5 sigma over half of the episode, from 300 trajectories of noise of 1 sigma."""
    z = np.random.default_rng(0).standard_normal((300, STEPS, 2))
    z[:, : STEPS // 2, 1] += 0.5
    model = make_model()
    train(model, make_examples(z), 300)
    mean = model.sample(np.zeros(2000, np.float32), 0.0, draw=2).mean(axis=0)
    assert mean[: STEPS // 2, 1].mean() == pytest.approx(0.5, abs=0.15)
    assert mean[STEPS // 2 :, 1].mean() == pytest.approx(0.0, abs=0.15)
    assert mean[:, 0].mean() == pytest.approx(0.0, abs=0.15)


def test_moved_noise_from_the_prior_is_noise_from_the_prior():
    random = np.random.default_rng(0)
    z = move(random.standard_normal((4000, STEPS, 2)).astype(np.float32), random)
    assert z.dtype == np.float32
    flat = z.reshape(len(z), -1).astype(np.float64)
    assert np.abs(flat.mean(axis=0)).max() < 0.1
    assert np.abs(np.cov(flat, rowvar=False) - np.eye(2 * STEPS)).max() < 0.12


def test_moved_noise_is_shifted_as_a_whole_and_each_channel_mirrored_or_not():
    steps = np.arange(100.0, 100.0 + STEPS, dtype=np.float32)
    z = np.stack([steps, 1000.0 * steps], axis=1)[None].repeat(500, axis=0)
    moved = move(z, np.random.default_rng(1))
    shifts, signs = [], set()
    for each in moved:
        # New draws are far below 50.
        kept = np.flatnonzero(np.abs(each[:, 0]) > 50.0)
        np.testing.assert_array_equal(1000.0 * np.abs(each[kept, 0]), np.abs(each[kept, 1]))
        assert (np.diff(np.abs(each[kept, 0])) == 1.0).all()
        shifts.append(int(kept[0] - (np.abs(each[kept[0], 0]) - 100.0)))
        signs.add(tuple(np.sign(each[kept[0]])))
    assert min(shifts) < -STEPS // 2
    assert max(shifts) > STEPS // 2
    assert max(map(abs, shifts)) < STEPS
    assert len(signs) == 4


def test_moved_trajectories_have_half_of_the_elite_if_there_are_five():
    elite = np.array([True] * 11 + [False] * 4)
    moved = np.zeros(15, bool)
    moved[[0, 1, 2, 3, 12]] = True
    np.testing.assert_allclose(weigh_elite(elite, moved), np.r_[np.full(11, 1 / 11), np.zeros(4)])
    moved[4] = True
    expected = np.r_[np.full(5, 0.1), np.full(6, 0.5 / 6), np.zeros(4)]
    np.testing.assert_allclose(weigh_elite(elite, moved), expected)
    np.testing.assert_allclose(weigh_elite(moved, moved), moved / 6)


def test_moved_samples_keep_regions_that_a_network_of_its_own_samples_loses():
    """A push of five steps at any time and in either direction, with two channels; two seeds."""

    def sum_pushes(z):
        total = np.cumsum(np.pad(z[:, :, 0], ((0, 0), (1, 0))), axis=1)
        return (total[:, 5:] - total[:, :-5]) / 5**0.5

    def count_regions(share, seed):
        learner = make_difs(
            horizon=STEPS, episodes=1500, width=24, round_size=125, steps=100, moved_share=share
        )
        engine = FunctionEngine(of_batch(lambda z: 5.0 - np.abs(sum_pushes(z)).max(axis=1)), STEPS)
        list(run_in_process(Rounds(learner, seed, 1500), engine))
        sums = sum_pushes(noise_of(learner.exploit(300)).astype(np.float64))
        begin = np.abs(sums).argmax(axis=1)
        largest = sums[np.arange(len(sums)), begin]
        found = np.abs(largest) >= 5.0
        return len(set(zip(begin[found] // 6, largest[found] > 0, strict=True)))

    without, moved = (sum(count_regions(share, seed) for seed in (5, 6)) for share in (0.0, 0.3))
    assert moved >= without + 2
    assert moved >= 10


def test_moved_samples_are_kept_apart_whichever_episodes_err():
    learner = make_difs(
        horizon=STEPS, episodes=40, round_size=20, moved_share=0.5, first_steps=2, steps=2
    )
    engine = FunctionEngine(
        of_batch(lambda z: np.where(z[:, 0, 0] > 0.0, np.nan, 3.0 - z[:, 1, 0])), STEPS
    )
    for first in (0, 20):
        sources = learner.propose(20).sources
        tasks = [EpisodeTask(first + i, first + i, each) for i, each in enumerate(sources)]
        results = list(engine.run(tasks))
        learner.observe(results)
    assert [isinstance(one, PriorSource) for one in sources] == [True] * 4 + [False] * 16
    kept = [each.noise.z for each in results[-8:] if each.measures is not None]
    assert 0 < len(kept) < 8
    facts = DiffusionFailureSampling._Facts
    arrays = archive.read("difs", learner.state(), facts)[1]
    np.testing.assert_array_equal(arrays["moved.z"], np.stack(kept))


def test_first_round_is_from_the_prior_and_a_fifth_of_each_later_one():
    learner = make_difs(horizon=STEPS, episodes=160, round_size=20, first_steps=5, steps=5)
    engine = FunctionEngine(of_batch(lambda z: 3.0 - z[:, 0, 0]), STEPS)
    rounds = Rounds(learner, 1, 80)
    list(run_in_process(rounds, engine))
    sources = learner.propose(20).sources
    assert sum(isinstance(one, PriorSource) for one in sources) == 4
    assert len(learner.propose(100).sources) == 20, "a round"
    fresh = make_difs(horizon=STEPS, episodes=80, round_size=20)
    assert fresh.propose(20).sources == (PriorSource(),) * 20


@pytest.mark.parametrize(
    ("episodes", "sizes"), [(620, [42] * 14 + [32]), (200, [40] * 5), (20, [5] * 4), (5, [2, 2, 1])]
)
def test_rounds_are_at_most_fifteen(episodes, sizes):
    learner = make_difs(horizon=STEPS, episodes=episodes, first_steps=1, steps=1)
    rounds = Rounds(learner, 1, episodes)
    engine = FunctionEngine(of_batch(lambda z: 3.0 - z[:, 0, 0]), STEPS)
    seen = []
    watched, learner.observe = (
        learner.observe,
        lambda results: (
            seen.append(len(results)),
            watched(results),
        ),
    )
    list(run_in_process(rounds, engine))
    assert seen == sizes


@pytest.mark.parametrize("share", [0.0, 0.6, 1.0])
def test_samples_stay_finite_whatever_share_of_the_first_round_fails(share):
    learner = make_difs(horizon=STEPS, episodes=60, round_size=20, first_steps=20, steps=10)
    border = -NORMAL.inv_cdf(share) if 0.0 < share < 1.0 else (9.0 if share == 0.0 else -9.0)
    engine = FunctionEngine(of_batch(lambda z: 1e4 * (border - z[:, 0, 0])), STEPS)
    list(run_in_process(Rounds(learner, 1, 60), engine))
    z = noise_of(learner.exploit(50))
    assert np.isfinite(z).all()
    assert (z**2).mean() < 3.0


def test_rounds_of_draws_from_the_prior_alone_go_on():
    learner = make_difs(
        horizon=STEPS, episodes=40, round_size=1, prior_share=0.9, first_steps=1, steps=1
    )
    engine = FunctionEngine(of_batch(lambda z: 3.0 - z[:, 0, 0]), STEPS)
    assert len(list(run_in_process(Rounds(learner, 1, 20), engine))) == 20
    assert learner.propose(1).sources == (PriorSource(),)


def test_likely_trajectories_of_the_elite_weigh_more():
    elite = np.array([True, False, True, True])
    excess = np.array([5.0, 0.0, -1.0, 9.0], np.float32)
    factors = prefer_likely(elite, excess, 2.0)
    np.testing.assert_allclose(factors, np.exp([-1.0, 0.0, 0.0, -2.0]))
    np.testing.assert_array_equal(prefer_likely(elite, excess, 0.0), np.ones(4))


def test_smaller_target_gives_likelier_noise():
    squares = []
    for target in (0.05, 0.9):
        learner = make_difs(
            horizon=STEPS,
            episodes=900,
            width=24,
            round_size=75,
            steps=100,
            target_rate=target,
            first_steps=300,
        )
        engine = FunctionEngine(of_batch(lambda z: 3.5 - sum_windows(z).max(axis=1)), STEPS)
        list(run_in_process(Rounds(learner, 3, 900), engine))
        squares.append((noise_of(learner.exploit(200)) ** 2).mean())
    assert squares[0] < squares[1] - 0.05


def sum_windows(z):
    """Standardised sums of the first channel over four windows, shape (n, 4)."""
    return z[:, :, 0].reshape(len(z), 4, -1).sum(axis=2) / (STEPS // 4) ** 0.5


@pytest.mark.parametrize("seed", [3, 4])
def test_failures_in_several_regions_are_found_and_stay_likely(seed):
    """Each of four windows fails with a probability of 1.3e-3 under p(x)."""
    learner = make_difs(horizon=STEPS, episodes=2000, width=32, round_size=200, steps=150)
    engine = FunctionEngine(of_batch(lambda z: 3.0 - sum_windows(z).max(axis=1)), STEPS)
    list(run_in_process(Rounds(learner, seed, 2000), engine))
    z = noise_of(learner.exploit(300)).astype(np.float64)
    failed = z[sum_windows(z).max(axis=1) >= 3.0]
    assert len(failed) >= 60, "37 times as often as under p(x), or more"
    assert len(np.unique(sum_windows(failed).argmax(axis=1))) >= 3
    assert (failed**2).mean() < 1.6
