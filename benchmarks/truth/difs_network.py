"""Figures: what the network of DiFS adds over the mixture alone, on functions of noise.

`python -m benchmarks.truth.difs_network` prints them as a table.
"""

from collections.abc import Iterator
from itertools import product
from typing import Any, NamedTuple

import msgspec
import numpy as np
from benchmarks.episode_pool import EpisodePool, open_pool
from benchmarks.figures import Figure
from benchmarks.learning_figures import of_seeds
from benchmarks.searches import context, search_function
from benchmarks.truth.known_problems import EXAMPLES, Noise

from eigenfail import plugins
from eigenfail.settings import read_settings
from eigenfail.values.campaign_spec import CampaignSpec

PROBLEMS = ("braking", "walk", "two_sides", "two_corners", "four_branches")
TRAINED, SAMPLED, SEEDS = 1000, 300, 5

FIXED_GUIDANCE = -0.25
"""About where the guidance of the default settings ends on these problems."""

MODELS: dict[str, dict[str, Any]] = {"mixture": {"first_steps": 0, "steps": 0}, "network": {}}
SCHEDULES = ("many_rounds", "paper")
GUIDANCES: dict[str, dict[str, Any]] = {
    "own": {},
    "fixed": {"final_guidance": FIXED_GUIDANCE},
}
"""Guidance of the samples: that of the last round, or the same for both models."""


class Samples(NamedTuple):
    """Failures among the samples, and log p per step of them (None without any)."""

    failures: float
    log_p_per_step: float | None


def find(pool: EpisodePool, seed: int) -> Iterator[tuple[str, Figure]]:
    """Failures of samples at robustness 0 after training, with the network and without."""
    for problem, schedule in product(PROBLEMS, SCHEDULES):
        for model in MODELS:
            given = [problem] * SEEDS, [schedule] * SEEDS, [model] * SEEDS
            runs = pool.each(train_and_sample, *given, range(seed, seed + SEEDS))
            for guidance in GUIDANCES:
                found = [run[guidance] for run in runs]
                place = f"difs.network.{problem}.{schedule}.{model}.{guidance}_guidance"
                failures = [one.failures for one in found]
                yield f"{place}.failures", of_seeds(failures, "episodes", SAMPLED)
                log_ps = [one.log_p_per_step for one in found]
                yield f"{place}.log_p_per_step", of_seeds(log_ps, "nat", SAMPLED)


def train_and_sample(problem: str, schedule: str, model: str, seed: int) -> dict[str, Samples]:
    """Run a campaign, and sample its model at robustness 0 with each guidance."""
    settings = {"schedule": schedule, **MODELS[model]}
    spec = CampaignSpec(name=problem, method="difs", episodes=TRAINED, seed=seed, settings=settings)
    state = search_function(spec, EXAMPLES[problem]).state
    return {
        name: sample(msgspec.structs.replace(spec, settings=settings | guidance), problem, state)
        for name, guidance in GUIDANCES.items()
    }


def sample(spec: CampaignSpec, problem: str, state: bytes) -> Samples:
    """Sample what a campaign has learnt."""
    known, method = EXAMPLES[problem], plugins.load(plugins.METHODS, spec.method)
    settings = read_settings(method.Settings, spec.settings, "settings")
    learner = method(context(spec, known.steps, None), settings)
    learner.restore(state)
    z = np.stack([source.z for source in learner.exploit(SAMPLED).sources]).astype(np.float64)
    failures = z[known.robustness(z) <= 0.0]
    return Samples(float(len(failures)), mean_log_p(failures) if len(failures) else None)


def mean_log_p(z: Noise) -> float:
    """Mean log p of a step of standard normal noise, shape (n, steps, 2)."""
    squares = float(np.mean(np.sum(z**2, axis=2)))
    return float(-np.log(2.0 * np.pi)) - 0.5 * squares


def table(figures: dict[str, Figure]) -> Iterator[str]:
    """A line for each problem and schedule: failures and log p per step of both models."""
    pairs = list(product(GUIDANCES, MODELS))
    heads = " ".join(f"{f'{model}, {guidance}':>18}" for guidance, model in pairs)
    yield f"{'failures of ' + str(SAMPLED) + ', log p a step':<28} {heads}"
    for problem, schedule in product(PROBLEMS, SCHEDULES):
        cells = []
        for guidance, model in pairs:
            place = f"difs.network.{problem}.{schedule}.{model}.{guidance}_guidance"
            failures, log_p = (figures[f"{place}.{n}"] for n in ("failures", "log_p_per_step"))
            likely = "–" if log_p.value is None else f"{log_p.value:.3f}"
            cells.append(f"{failures.value:>9.0f} {likely:>8}")
        yield f"{f'{problem}, {schedule}':<28} {' '.join(cells)}"


def main() -> None:
    """Find and print."""
    with open_pool() as hands:
        figures = dict(find(hands, seed=101))
    print("\n".join(table(figures)))


if __name__ == "__main__":
    main()
