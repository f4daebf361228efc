"""The table of workers in benchmarks/scale.md: what the model makes of what was measured."""

from collections.abc import Iterator, Mapping
from math import ceil

from benchmarks.figures import Figure
from benchmarks.speed.scale_model import Prediction, predict
from benchmarks.speed.scale_parts import GROUP, Costs, Method, WorkerPool

from eigenfail.values.learning import count_rounds_ahead

EPISODE_S = 1.0
"""What a made-up worker sleeps over an episode."""

IDLE = 1_000
"""Workers of `hub_idle_1000_core`."""

CREWS = (10, 100, 1_000, 10_000)
NAMES = {
    "monte_carlo": "`monte_carlo`",
    "many": "`monte_carlo`, `round_size` 2000",
    "ast": "`ast`",
    "difs": "`difs`",
    "monte_carlo_parallel": "`monte_carlo`, `parallel` 1000",
    "ast_parallel": "`ast`, `parallel` 100",
}
LOOKAHEAD = {
    "monte_carlo": 3,
    "many": 3,
    "ast": 1,
    "difs": 0,
    "monte_carlo_parallel": count_rounds_ahead(1_000, 100, 3),
    "ast_parallel": count_rounds_ahead(100, 10, 1),
}
PLAYED = 100
"""Rounds in the simulation, or more: each worker has ten episodes in them."""

NETWORK_BYTES_PER_S = 1e9 / 8
DISK_BYTES_PER_S = 200e6
"""A network of 1 Gbit/s and a disk that writes 200 MB/s: assumed, not measured."""

HEADS = (
    *("method", "workers", "episodes of 1 s: predicted /s", "measured /s", "limited by"),
    *("episodes of `cut_in`: predicted /s", "limited by"),
)


def value(figures: Mapping[str, Figure], name: str) -> float:
    """Of a figure that was measured."""
    found = figures[name].value
    assert found is not None
    return found


def costs_of(figures: Mapping[str, Figure]) -> Costs:
    """What the hub was measured to take; at its limit, groups are full."""
    commit_s = value(figures, "commit_ms") / 1000.0
    return Costs(
        result_s=max(0.0, 1.0 / value(figures, "hub_results_per_s") - commit_s / GROUP),
        commit_s=commit_s,
        heartbeat_s=value(figures, "hub_idle_1000_core") / IDLE,
        wire_bytes=value(figures, "result_wire_bytes"),
        disk_bytes=value(figures, "result_disk_bytes"),
        wire_bytes_per_s=NETWORK_BYTES_PER_S,
        disk_bytes_per_s=DISK_BYTES_PER_S,
    )


def method_of(name: str, figures: Mapping[str, Figure]) -> Method:
    """A method as it was measured."""
    told = figures[f"learner_ms_{name}"]
    return Method(
        round_size=int(told.note.split()[2]),
        lookahead=LOOKAHEAD[name],
        learn_s=value(figures, f"learner_ms_{name}") / 1000.0,
        checkpoint_s=value(figures, f"checkpoint_ms_{name}") / 1000.0,
    )


def predict_rate(
    name: str, workers: int, episode_s: float, figures: Mapping[str, Figure]
) -> Prediction:
    """What the model says."""
    method = method_of(name, figures)
    played = PLAYED + ceil(10 * workers / method.round_size)
    return predict(method, WorkerPool(workers, episode_s), costs_of(figures), played)


def table(figures: Mapping[str, Figure]) -> Iterator[str]:
    """In Markdown: what is predicted and measured, and what stands in the way of more."""
    episode_s = value(figures, "episode_cpu_ms") / 1000.0
    yield f"| {' | '.join(HEADS)} |"
    yield "|---|--:|--:|--:|---|--:|---|"
    for name, words in NAMES.items():
        for workers in CREWS:
            seen = figures.get(f"rate_{name}_{workers}")
            sleepers = predict_rate(name, workers, EPISODE_S, figures)
            real = predict_rate(name, workers, episode_s, figures)
            cells = (
                words,
                f"{workers:,}",
                format_digits(sleepers.episodes_per_s),
                format_digits(seen.value if seen else None),
                sleepers.bottleneck,
                format_digits(real.episodes_per_s),
                real.bottleneck,
            )
            yield f"| {' | '.join(cells)} |"


def format_digits(rate: float | None) -> str:
    """Three digits; nothing where nothing was measured."""
    return "" if rate is None else f"{float(f'{rate:.3g}'):,.4g}".replace("e+03", "")
