"""Figures: how long an action of `ast` lasts, and what else decides whether it finds failures.

`cut_in` has steps of 0.1 s. The base is the algorithm with the values of the paper's main runs.
Each row changes one of them. Restarts and the end of training are off: they would hide what a row
does.
"""

from collections.abc import Iterator, Mapping
from types import MappingProxyType
from typing import Any

import numpy as np
from benchmarks.episode_pool import EpisodePool
from benchmarks.figures import Figure
from benchmarks.learning_figures import failure_rate, log_p_per_step, of_seeds
from benchmarks.samples import share
from benchmarks.searches import count_steps, list_evaluations, search
from benchmarks.truth.shapes import draw_held_noise

from eigenfail.values.campaign_spec import CampaignSpec

STEPS_PER_S = 10
LENGTHS_S = (0.1, 0.2, 0.5, 1.0)
SEEDS, EPISODES, EVALUATED, DRAWN = 5, 1000, 100, 500

PAPER: Mapping[str, Any] = MappingProxyType(
    {
        "alpha": 5000.0,
        "c_dist": 1000.0,
        "tau": 0.001,
        "learning_rate": 3e-4,
        "batch_size": 16,
        "buffer_size": 10_000,
        "gamma": 0.99,
        "n_step": 1,
        "amplitude": 3.0,
        "patience": None,
        "averaged": 1,
    }
)
"""Values of the paper's main runs. The paper does not give `gamma`, `n_step` and the amplitude.

There are no restarts, and an evaluation runs the last policy.
"""

SHORT_AND_LONG_S = (0.1, 1.0)

ROWS: Mapping[str, tuple[Mapping[str, Any], tuple[float, ...]]] = MappingProxyType(
    {
        "paper": ({}, LENGTHS_S),
        "amplitude_2": ({"amplitude": 2.0}, LENGTHS_S),
        "n_step_10": ({"n_step": 10}, SHORT_AND_LONG_S),
        "gamma_1": ({"gamma": 1.0}, SHORT_AND_LONG_S),
        "tau_0.01": ({"tau": 0.01}, SHORT_AND_LONG_S),
        "gradient_steps_4": ({"gradient_steps": 4}, SHORT_AND_LONG_S),
        "sb3": ({"trainer": "sb3"}, LENGTHS_S[:1]),
    }
)
"""What each row changes, and how long its actions last."""


def find(pool: EpisodePool, seed: int) -> Iterator[tuple[str, Figure]]:
    """What each row finds with actions of some lengths, and uniform noise without learning."""
    for amplitude in (2.0, 3.0):
        for length_s in LENGTHS_S:
            name = f"uniform_{amplitude:g}"
            yield f"ast.length.{name}.{length_s:g}s", draw_uniform(pool, amplitude, length_s, seed)
    for name, (changes, lengths_s) in ROWS.items():
        for length_s in lengths_s:
            yield from describe(pool, name, changes, length_s, seed)


def make_spec(changes: Mapping[str, Any], length_s: float, seed: int) -> CampaignSpec:
    """A campaign of the base with some settings changed."""
    settings = {**PAPER, **changes, "hold": round(length_s * STEPS_PER_S)}
    return CampaignSpec(name="ast", method="ast", episodes=EPISODES, seed=seed, settings=settings)


def describe(
    pool: EpisodePool, name: str, changes: Mapping[str, Any], length_s: float, seed: int
) -> Iterator[tuple[str, Figure]]:
    """The share of episodes that fail in training, and of the policy without learning."""
    trained = pool.each(search, [make_spec(changes, length_s, seed + i) for i in range(SEEDS)])
    place = f"ast.length.{name}.{length_s:g}s"
    yield f"{place}.train", of_seeds([failure_rate(one) for one in trained], "share", EPISODES)
    evaluated = pool.each(search, list_evaluations(trained, EVALUATED), trained)
    shares = [failure_rate(one) for one in evaluated]
    yield f"{place}.evaluation", of_seeds(shares, "share", EVALUATED)
    log_p = [log_p_per_step(one) for one in trained]
    yield f"{place}.log_p_per_step", of_seeds(log_p, "nat", EPISODES)


def draw_uniform(pool: EpisodePool, amplitude: float, length_s: float, seed: int) -> Figure:
    """How often noise fails that is uniform within an amplitude and keeps its value for a time."""
    spec = make_spec({}, length_s, seed)
    random, hold = np.random.default_rng(seed), round(length_s * STEPS_PER_S)
    noise = draw_held_noise(random, DRAWN, count_steps(spec), sigma=amplitude, hold=hold)
    return share([one.is_failure for one in pool.inject(spec.setup(), noise)])
