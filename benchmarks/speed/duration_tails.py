"""How many episodes of `ast` must be open where some take far longer than others: simulated.

Rounds are observed in order, so the slowest episode of the oldest round holds up the proposal of
the next one. With `parallel = 100`, 150 episodes are open; how fast they end is a bound for any
number of workers, which 10,000 workers come close to.

`python -m benchmarks.speed.duration_tails` prints the rates from the costs in
benchmarks/results/latest.json; with `write` it writes them there.
"""

import sys
from collections.abc import Callable, Mapping
from functools import partial
from math import exp
from random import Random

import msgspec
from benchmarks.figures import RESULTS, Figure, show, summarize_runs, write
from benchmarks.speed.scale_model import predict
from benchmarks.speed.scale_parts import WorkerPool
from benchmarks.speed.scale_table import EPISODE_S, costs_of, method_of
from msgspec.structs import replace

from eigenfail.values.learning import count_rounds_ahead

LATEST = RESULTS / "latest.json"

TAIL = 0.5
"""Standard deviation of log durations: one episode in a hundred takes 2.8 times the mean."""

PARALLEL = 100
WIDER = 170
"""`parallel` of a campaign for 100 workers that expects such durations."""

MANY = 10_000
"""Workers of whom hardly any ever has an episode: the rate is that of the rounds."""

LEAST = 1
"""Rounds that `ast` keeps open besides the oldest without `parallel`."""

SEEDS = range(1, 6)
ROUNDS = 400


def make_draw(tail: float, seed: int) -> Callable[[], float]:
    """Return log-normal durations with mean `EPISODE_S`, one at each call. [s]"""
    random = Random(seed)
    return lambda: EPISODE_S * exp(tail * random.gauss() - tail**2 / 2)


def play_tail(figures: Mapping[str, Figure], parallel: int, workers: int) -> Figure:
    """Return the episodes per second of `ast` with some workers: median of the seeds."""
    method = method_of("ast_parallel", figures)
    ahead = count_rounds_ahead(parallel, method.round_size, LEAST)
    play = partial(
        predict, replace(method, lookahead=ahead), WorkerPool(workers, EPISODE_S), costs_of(figures)
    )
    rates = [play(ROUNDS, make_draw(TAIL, seed)).episodes_per_s for seed in SEEDS]
    return summarize_runs(rates, "1/s", note=f"simulated, {ROUNDS} rounds, seeds 1 to 5")


def tail_figures(figures: Mapping[str, Figure]) -> dict[str, Figure]:
    """Return the simulated rates, from the costs of a result and of a round."""
    return {
        "tail_ast_100": play_tail(figures, PARALLEL, workers=100),
        "tail_ast_bound": play_tail(figures, PARALLEL, workers=MANY),
        "tail_ast_170": play_tail(figures, WIDER, workers=100),
    }


def main() -> None:
    """Print the rates, and write them if that is asked for."""
    known = msgspec.json.decode(LATEST.read_bytes(), type=dict[str, Figure])
    found = tail_figures(known)
    if "write" in sys.argv:
        write(LATEST, known | found)
    show(found)


if __name__ == "__main__":
    main()
