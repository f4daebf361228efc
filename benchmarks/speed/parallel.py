"""Figures: failures of `ast` on `cut_in` with 100 workers to keep busy, and with two rounds open.

With 100 workers a policy has learnt from no episode of the 140 before its round. The episodes are
those of the service with any number of workers: they depend on the campaign's `parallel` alone.
"""

from collections.abc import Iterator
from itertools import product

import numpy as np
from benchmarks.episode_pool import EpisodePool
from benchmarks.figures import Figure
from benchmarks.learning_figures import first_failure, log_p_per_step, middle
from benchmarks.samples import COMMAND
from benchmarks.searches import side_by_side

from eigenfail.values.campaign_spec import CampaignSpec

SEEDS, EPISODES, PARALLEL = 12, 1000, 100
UNSEEN = 500
"""Added to the seed: seeds that no setting was chosen by."""


def find_figures(pool: EpisodePool, seed: int) -> Iterator[tuple[str, Figure]]:
    """Run the campaigns, and compare their failures."""
    seeds = range(seed + UNSEEN, seed + UNSEEN + SEEDS)
    runs = side_by_side(pool, [make_spec(*one) for one in product(seeds, (None, PARALLEL))])
    narrow, wide = runs[::2], runs[1::2]
    counts = [(sum(a.crashed), sum(b.crashed)) for a, b in zip(narrow, wide, strict=True)]
    of_narrow, of_wide = np.array(counts).T
    note = (
        f"failures with parallel = {PARALLEL} ÷ without, of {SEEDS} seeds: "
        + ", ".join(f"{b}/{a}" for a, b in counts)
        + f"; the smallest ratio of a seed is {(of_wide / of_narrow).min():.3g}"
    )
    value = float(of_wide.sum() / of_narrow.sum())
    yield (
        "ast_parallel_100_failures",
        Figure(value=value, unit="ratio", n=SEEDS, command=COMMAND, note=note),
    )
    for name, found in (("ast_parallel_1", narrow), ("ast_parallel_100", wide)):
        yield f"{name}_log_p", middle(found, log_p_per_step, "nat", SEEDS)
        yield f"{name}_first_failure", middle(found, first_failure, "episode", SEEDS)


def make_spec(seed: int, parallel: int | None) -> CampaignSpec:
    """Return the campaign of a seed."""
    return CampaignSpec(
        name="ast",
        method="ast",
        episodes=EPISODES,
        seed=seed,
        settings={"converged_share": 1.0},
        scenario="cut_in",
        parallel=parallel,
    )
