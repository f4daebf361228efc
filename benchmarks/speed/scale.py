"""How fast a service is with many workers: predicted from what a result costs, and measured.

`python -m benchmarks.speed.scale` prints the table of benchmarks/scale.md from
benchmarks/results/latest.json; with `measure` it measures the figures first, with `write` it puts
the table into the page.
"""

import sys
from collections.abc import Mapping, Sequence
from math import ceil

import msgspec
from benchmarks.figures import RESULTS, ROOT, Figure, write
from benchmarks.speed.duration_tails import PARALLEL, TAIL, WIDER, tail_figures
from benchmarks.speed.hub import COMMAND, hub_figures, playing, run_simulated_workers
from benchmarks.speed.learner_cost import CASES
from benchmarks.speed.scale_costs import cost_figures
from benchmarks.speed.scale_table import CREWS, EPISODE_S, method_of, predict_rate, table
from sqlalchemy import text
from stage import Stage

LATEST = RESULTS / "latest.json"
PAGE = ROOT / "benchmarks" / "scale.md"
MARKS = ("<!-- workers -->", "<!-- /workers -->")

MEASURED = {
    "monte_carlo": CREWS[:3],
    "many": (1_000,),
    "ast": CREWS[:2],
    "monte_carlo_parallel": (1_000,),
    "ast_parallel": (100,),
}
SETTLED = {
    "monte_carlo": 100,
    "many": 2_000,
    "ast": 80,
    "monte_carlo_parallel": 2_000,
    "ast_parallel": 260,
}
"""Number of episodes after which the rate of a campaign is steady."""

WARM_S, SPAN_S = 4.0, 12.0
LEAST_ROUNDS = 3

LANDED_MS = text(
    "SELECT finished_ms FROM episodes WHERE campaign = :campaign"
    " ORDER BY finished_ms LIMIT 1 OFFSET :before"
)


def scale_figures(hub: Mapping[str, Figure]) -> dict[str, Figure]:
    """What a result and a round cost, and how fast crews of sleepers were.

    Args:
        hub: what the hub can take.
    """
    costs = cost_figures()
    rates = {
        f"rate_{name}_{workers}": measure_rate(name, workers, {**hub, **costs})
        for name, crews in MEASURED.items()
        for workers in crews
    }
    tails = {
        f"rate_ast_parallel_100_tail{end}": measure_rate(
            "ast_parallel", 100, {**hub, **costs}, parallel, tail=TAIL
        )
        for end, parallel in (("", PARALLEL), ("_wider", WIDER))
    }
    return costs | rates | tails | tail_figures({**hub, **costs})


def measure_rate(
    name: str,
    workers: int,
    figures: Mapping[str, Figure],
    parallel: int | None = None,
    **durations: float,
) -> Figure:
    """Episodes per second of a real hub and learner, with workers that sleep.

    Args:
        name: the case.
        workers: number of workers.
        figures: costs of a result and of a round, for the number of episodes that it takes.
        parallel: `parallel` of the campaign; that of the case if it is None.
        durations: options of the made-up workers.
    """
    case, method = CASES[name], method_of(name, figures)
    expected = predict_rate(name, workers, EPISODE_S, figures).episodes_per_s
    first = whole(max(SETTLED[name], WARM_S * expected), method.round_size)
    span = whole(SPAN_S * expected, method.round_size)
    span = max(span, LEAST_ROUNDS * method.round_size)
    with playing() as stage:
        services = stage.services()
        told = {
            "method": case.method,
            "settings": case.settings,
            "episodes": case.episodes,
            "parallel": parallel or case.parallel,
        }
        campaign = stage.create(**told, simulator="highway", planner="rulebook")
        with run_simulated_workers(services.hub, workers, EPISODE_S, **durations):
            stage.wait_for(campaign, first + span + 1)
            took_ms = landed_ms(stage, campaign, first + span) - landed_ms(stage, campaign, first)
    return Figure(value=1000.0 * span / took_ms, unit="1/s", n=span, command=COMMAND)


def whole(episodes: float, round_size: int) -> int:
    """As many rounds as it takes."""
    return ceil(episodes / round_size) * round_size


def landed_ms(stage: Stage, campaign: int, before: int) -> int:
    """When a result was committed before which there were so many."""
    return int(stage.ask(LANDED_MS, {"campaign": campaign, "before": before}))


def latest() -> dict[str, Figure]:
    """What was measured last."""
    return msgspec.json.decode(LATEST.read_bytes(), type=dict[str, Figure])


def put(lines: Sequence[str]) -> None:
    """Into the page, between its marks."""
    before, rest = PAGE.read_text().split(MARKS[0])
    after = rest.split(MARKS[1])[1]
    PAGE.write_text("\n".join((before + MARKS[0], *lines, MARKS[1] + after)))


def main() -> None:
    """As told."""
    if "measure" in sys.argv:
        hub = hub_figures()
        write(LATEST, latest() | hub | scale_figures(hub))
    lines = [*table(latest())]
    if "write" in sys.argv:
        put(lines)
    print("\n".join(lines))


if __name__ == "__main__":
    main()
