"""Figures: how often samples of `mixture_ce` fail on `cut_in`, and how likely these failures are.

Episodes and seeds are those of the figures `cut_in.difs.*` and `cut_in.cem.*`.
"""

from collections.abc import Iterator

from benchmarks.episode_pool import EpisodePool
from benchmarks.figures import Figure
from benchmarks.learning_figures import log_p_ratio, middle
from benchmarks.searches import evaluations
from benchmarks.targets import Target
from benchmarks.truth.learning import EVALUATED, learnt, summarise_evaluation

PLACE = "cut_in.mixture_ce"


def sample_after_training(pool: EpisodePool, seed: int) -> Iterator[tuple[str, Figure]]:
    """Yield what 300 samples after each campaign show."""
    sampled = evaluations(pool, learnt(pool, seed, "mixture_ce"), EVALUATED)
    yield from summarise_evaluation(PLACE, sampled)
    yield f"{PLACE}.logp_ratio", middle(sampled, log_p_ratio, "ratio", EVALUATED)


TRIALS = (((f"{PLACE}.",), sample_after_training),)
TARGETS = {
    f"{PLACE}.eval{EVALUATED}.failure_rate": Target(low=0.10),
    f"{PLACE}.logp_ratio": Target(low=0.95, high=1.20),
}
