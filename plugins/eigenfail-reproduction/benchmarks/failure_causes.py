"""Figures: tested causes of statements of the paper that do not hold on `cut_in`.

Failures of AST are run again with a part of their noise alone or without it. The sweep's smallest
batch is trained again with four times as many gradient steps, on as many decisions as the base, and
so is the base.
"""

import sys
from collections.abc import Iterator
from pathlib import Path

sys.path.append(str(Path(__file__).parents[3]))

import msgspec
import numpy as np
from benchmarks.episode_pool import EpisodePool
from benchmarks.figures import Figure
from benchmarks.learning_figures import of_seeds
from benchmarks.searches import Found, list_evaluations, search

from eigenfail.values.arrays import Floats
from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail.values.episode import EpisodeTask, TrajectorySource
from eigenfail_reproduction.programme import PROGRAMMES, SWEPT, build_suite
from eigenfail_workers.engine import Engine

PROGRAMME = PROGRAMMES["cut_in"]
LEARNERS = ("ast", "ast_paper")
SEEDS, EVALUATED = 5, 100

LAST = round(1.0 / PROGRAMME.step_s)
"""Steps in the last second before the collision."""

PARTS = {
    "without_lateral": (np.s_[:], np.s_[1:]),
    "without_longitudinal": (np.s_[:], np.s_[:1]),
    "without_last_second": (np.s_[-LAST:], np.s_[:]),
    "last_second_alone": (np.s_[:-LAST], np.s_[:]),
}
"""Steps and channels whose noise is left out, by what remains."""


def find(pool: EpisodePool, seed: int) -> Iterator[tuple[str, Figure]]:
    """The figures, over five seeds."""
    each = range(seed, seed + SEEDS)
    for learner in LEARNERS:
        shares = pool.each(replay_parts, [learner] * SEEDS, each)
        for name in PARTS:
            values = [found[name] for found in shares]
            yield f"paper.causes.{learner}.{name}", of_seeds(values, "share", SEEDS)
    episodes = build_member("sweep base", seed).episodes
    for name, member in {"batch_16": "sweep batch_size=16", "batch_64": "sweep base"}.items():
        failures = pool.each(count_with_more_steps, [member] * SEEDS, each)
        yield f"paper.causes.{name}.failures", of_seeds(failures, "episodes", episodes)


def build_member(name: str, seed: int) -> CampaignSpec:
    """A campaign of the programme."""
    suite = build_suite("full", seed)
    return next(member.spec for member in suite.members if member.name == name)


def replay_parts(learner: str, seed: int) -> dict[str, float | None]:
    """The share of a learner's failures that fail again, for each part that is left out."""
    trained = search(build_member(learner, seed))
    (spec,) = list_evaluations([trained], EVALUATED)
    failures = [crash.z for crash in search(spec, trained).crashes]
    return {name: replay_share(trained, failures, name) for name in PARTS}


def replay_share(trained: Found, failures: list[Floats], part: str) -> float | None:
    """The share of failures that fail again without a part of their noise; None without any."""
    if not failures:
        return None
    tasks = []
    for number, z in enumerate(failures):
        left = z.copy()
        left[PARTS[part]] = 0.0
        tasks.append(EpisodeTask(number, 0, TrajectorySource(left)))
    results = Engine(trained.spec.setup()).run(tasks)
    return sum(result.is_failure for result in results) / len(failures)


def count_with_more_steps(member: str, seed: int) -> float:
    """Failures with four times as many gradient steps: a batch of 16 sees what the base saw."""
    spec = build_member(member, seed)
    steps = 4 * SWEPT["gradient_steps"]
    more = msgspec.structs.replace(spec, settings={**spec.settings, "gradient_steps": steps})
    return float(sum(search(more).crashed))


TRIALS = ((("paper.causes.",), find),)
