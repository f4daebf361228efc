"""The fast trainer is stable-baselines3's soft actor-critic: same weights in, same out."""

import msgspec
import numpy as np
import pytest
from benchmarks.truth.trainers import (
    CHANNELS,
    NETWORKS,
    PAPER,
    compare_updates,
    copy_weights,
    draw_as_given,
    get_model,
    make_transitions,
)

from eigenfail_services.methods.ast.settings import TRAINERS, AstSettings, make_trainer
from eigenfail_services.methods.ast.trainer_numpy import FastTrainer
from eigenfail_services.methods.ast.trainer_sb3 import SacTrainer

BATCH = 16
SEED, OTHER_SEED = 3, 4

SETTINGS = AstSettings(
    learning_rate=1e-3,
    batch_size=BATCH,
    buffer_size=200,
    tau=0.01,
    gamma=0.97,
    hidden=(24, 16),
    entropy=50.0,
    target_entropy=-1.0,
    amplitude=2.0,
    hold=5,
    n_step=1,
)


def of(name):
    return msgspec.structs.replace(SETTINGS, trainer=name)


def transitions(count, seed=0):
    return make_transitions(count, np.random.default_rng(seed), 2)


@pytest.mark.parametrize("channels", CHANNELS)
def test_an_update_with_the_papers_settings_is_that_of_stable_baselines3(channels):
    assert max(compare_updates(PAPER, channels, SEED)) <= 1e-6


@pytest.mark.parametrize("channels", CHANNELS)
def test_forty_updates_lead_to_the_same_weights(channels):
    sac, fast = SacTrainer(SETTINGS, channels, SEED), FastTrainer(SETTINGS, channels, SEED)
    assert fast.entropy[0] == pytest.approx(float(get_model(sac).log_ent_coef.detach()), abs=1e-6)
    copy_weights(sac, fast)
    random = np.random.default_rng(1)
    given = make_transitions(150, random, channels)
    sac.add(given)
    fast.add(given)
    rows = random.integers(150, size=(40, BATCH))
    eps = random.standard_normal((40, 2, BATCH, channels), np.float32)
    with draw_as_given(sac, rows, eps):
        get_model(sac).train(gradient_steps=40, batch_size=BATCH)
    for i in range(40):
        fast.step(fast.memory.select_rows(rows[i]), eps[i, 0], eps[i, 1])
    mirror, started = (FastTrainer(SETTINGS, channels, SEED) for _ in range(2))
    copy_weights(sac, mirror)
    copy_weights(SacTrainer(SETTINGS, channels, SEED), started)
    for name in NETWORKS:
        ours, theirs = getattr(fast, name).weights, getattr(mirror, name).weights
        assert np.abs(theirs - getattr(started, name).weights).max() > 1e-3, "nothing was learnt"
        np.testing.assert_allclose(ours, theirs, rtol=0.0, atol=2e-5)
    assert fast.entropy[0] == pytest.approx(mirror.entropy[0], abs=1e-6)


@pytest.mark.parametrize("name", TRAINERS)
def test_a_restored_trainer_goes_on_bit_for_bit(name):
    first, second = make_trainer(of(name), 2, SEED), make_trainer(of(name), 2, SEED)
    first.add(transitions(250))
    first.train(5, draw=1)
    second.add(transitions(7, seed=5))
    second.train(2, draw=9)
    second.load({key: array.copy() for key, array in first.arrays().items()})
    for trainer in (first, second):
        trainer.add(transitions(20, seed=2))
        trainer.train(5, draw=2)
    for key, array in first.arrays().items():
        np.testing.assert_array_equal(array, second.arrays()[key], err_msg=key)


@pytest.mark.parametrize("name", TRAINERS)
def test_the_oldest_transitions_make_room(name):
    trainer = make_trainer(of(name), 2, SEED)
    trainer.add(transitions(150))
    trainer.add(transitions(150, seed=1))
    kept = [array for array in trainer.arrays().values() if array.size == 200]
    rewards = np.concatenate([transitions(150).rewards, transitions(150, seed=1).rewards])[100:]
    assert any(np.allclose(np.sort(array.reshape(-1)), np.sort(rewards) / 1000) for array in kept)


@pytest.mark.parametrize("name", TRAINERS)
def test_the_first_policy_depends_on_the_seed_alone(name):
    weights = [
        make_trainer(of(name), 2, seed).policy(0).mean.weight for seed in (SEED, SEED, OTHER_SEED)
    ]
    np.testing.assert_array_equal(weights[0], weights[1])
    assert not np.array_equal(weights[0], weights[2])


@pytest.mark.parametrize("name", TRAINERS)
def test_a_trainer_adopts_networks_and_nothing_else(name):
    first, second = make_trainer(of(name), 2, SEED), make_trainer(of(name), 2, OTHER_SEED)
    first.add(transitions(60))
    first.train(5, draw=1)
    second.adopt(first.arrays())
    np.testing.assert_array_equal(second.policy(0).mean.weight, first.policy(0).mean.weight)
    fresh = {key: array.shape for key, array in make_trainer(of(name), 2, SEED).arrays().items()}
    assert {key: array.shape for key, array in second.arrays().items()} == fresh


@pytest.mark.parametrize("name", TRAINERS)
def test_networks_of_another_shape_are_not_adopted(name):
    narrow = msgspec.structs.replace(of(name), hidden=(8, 8))
    with pytest.raises(ValueError, match="should have shape"):
        make_trainer(of(name), 2, SEED).adopt(make_trainer(narrow, 2, SEED).arrays())
