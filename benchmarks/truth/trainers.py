"""Figure: the difference between an update by the numpy trainer and one by stable-baselines3.

Both take the same weights, transitions and random draws. After each update the numpy trainer gets
the weights of SB3 again, so that the figure is the difference of one update.
"""

from collections.abc import Iterable, Iterator
from unittest import mock

import numpy as np
import torch
from benchmarks.episode_pool import EpisodePool
from benchmarks.figures import Figure
from benchmarks.samples import COMMAND
from stable_baselines3 import SAC

from eigenfail.values.arrays import Floats
from eigenfail.values.learning import count_state
from eigenfail_services.methods.ast.decisions import Decisions
from eigenfail_services.methods.ast.settings import AstSettings
from eigenfail_services.methods.ast.trainer_numpy import FastTrainer
from eigenfail_services.methods.ast.trainer_sb3 import SacTrainer

PAPER = AstSettings(alpha=5000.0, c_dist=1000.0, tau=0.001, learning_rate=3e-4, batch_size=16)
"""The values of the paper's main runs; its buffer of 10,000 is the default."""

CHANNELS, UPDATES, TRANSITIONS = (1, 2, 5), 40, 150
NETWORKS = ("actor", "critics", "targets")


def find_difference(_pool: EpisodePool, seed: int) -> Iterator[tuple[str, Figure]]:
    """The largest difference of a weight, or of the entropy coefficient, after one update."""
    found = [each for channels in CHANNELS for each in compare_updates(PAPER, channels, seed)]
    yield (
        "ast.fast_equals_sb3",
        Figure(
            value=max(found),
            unit="difference",
            n=len(found),
            note=f"{UPDATES} updates with each of {CHANNELS} channels, the paper's settings",
            command=COMMAND,
        ),
    )


def compare_updates(settings: AstSettings, channels: int, seed: int) -> Iterator[float]:
    """The largest difference after each of some updates from the same state."""
    sac, fast = SacTrainer(settings, channels, seed), FastTrainer(settings, channels, seed)
    mirror = FastTrainer(settings, channels, seed)
    copy_weights(sac, fast)
    random, batch = np.random.default_rng(seed), settings.batch_size
    given = make_transitions(TRANSITIONS, random, channels)
    sac.add(given)
    fast.add(given)
    rows = random.integers(TRANSITIONS, size=(UPDATES, batch))
    eps = random.standard_normal((UPDATES, 2, batch, channels), np.float32)
    with draw_as_given(sac, rows, eps):
        for i in range(UPDATES):
            get_model(sac).train(gradient_steps=1, batch_size=batch)
            fast.step(fast.memory.select_rows(rows[i]), eps[i, 0], eps[i, 1])
            copy_weights(sac, mirror)
            pairs = [
                (getattr(fast, name).weights, getattr(mirror, name).weights) for name in NETWORKS
            ]
            pairs.append((fast.entropy[:1], mirror.entropy[:1]))
            yield max(float(np.abs(ours - theirs).max()) for ours, theirs in pairs)
            for ours, theirs in pairs:
                ours[:] = theirs


def make_transitions(count: int, random: np.random.Generator, channels: int) -> Decisions:
    """Random transitions; a fifth of them end an episode, and rewards have the paper's size."""
    shape = count, count_state(channels)
    return Decisions(
        states=random.normal(size=shape).astype(np.float32),
        actions=random.uniform(-1.0, 1.0, (count, channels)).astype(np.float32),
        rewards=random.uniform(-9000.0, 0.0, count).astype(np.float32),
        next_states=random.normal(size=shape).astype(np.float32),
        ends=(random.uniform(size=count) < 0.2).astype(np.float32),
    )


def draw_as_given(sac: SacTrainer, rows: Iterable[Floats], eps: Floats) -> mock._patch:
    """Have SB3 draw these rows of its buffer, and these normal numbers, within the context."""
    get_model(sac).replay_buffer.generator = mock.Mock()
    get_model(sac).replay_buffer.generator.integers.side_effect = rows
    draws = torch.from_numpy(eps.reshape(-1, *eps.shape[2:]))
    return mock.patch.object(torch.distributions.normal, "_standard_normal", side_effect=draws)


def get_model(sac: SacTrainer) -> SAC:
    """The model of SB3 that a trainer wraps."""
    return sac._model  # noqa: SLF001 - what it computes inside is the subject


def copy_weights(sac: SacTrainer, fast: FastTrainer) -> None:
    """Copy the weights and the entropy coefficient of SB3 into the numpy trainer."""
    model = get_model(sac)
    trunk = [layer for layer in model.actor.latent_pi if isinstance(layer, torch.nn.Linear)]
    for layer, (weight, bias) in zip(trunk, fast.actor.layers, strict=False):
        weight[...], bias[...] = layer.weight.detach(), layer.bias.detach()
    heads = (model.actor.mu, model.actor.log_std)
    weight, bias = fast.actor.layers[-1]
    weight[...] = torch.cat([head.weight for head in heads]).detach()
    bias[...] = torch.cat([head.bias for head in heads]).detach()
    for theirs, own in ((model.critic, fast.critics), (model.critic_target, fast.targets)):
        for c, network in enumerate(theirs.q_networks):
            layers = [layer for layer in network if isinstance(layer, torch.nn.Linear)]
            for layer, (weight, bias) in zip(layers, own.layers, strict=True):
                weight[c], bias[c] = layer.weight.detach(), layer.bias.detach()
    fast.entropy[0] = float(model.log_ent_coef.detach())
