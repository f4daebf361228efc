"""Print the table of docs/noise.md: what each disturbance model does to the planners on cut_in."""

import sys
from collections.abc import Iterator
from statistics import fmean, median

from eigenfail.values import (
    Correlated,
    DisturbanceModel,
    EpisodeResult,
    EpisodeSetup,
    EpisodeTask,
    HeavyTailed,
    Outcome,
    PriorSource,
    episode_seed,
)
from eigenfail_services.statistics.intervals import rate
from eigenfail_workers.engine import Engine

SEED = 1301
EPISODES = 400
PLANNERS = ("rulebook", "idm")
MODELS = {
    "`white`": DisturbanceModel(),
    "`white`, `scale` 1.25": DisturbanceModel(scale=1.25),
    "`white`, `scale` 1.5": DisturbanceModel(scale=1.5),
    "`white`, `scale` 2": DisturbanceModel(scale=2.0),
    "`ar1`, 0.5 on both axes": DisturbanceModel(shape=Correlated(0.5, 0.5)),
    "`ar1`, 0.8 (default)": DisturbanceModel(shape=Correlated()),
    "`ar1`, 0.95": DisturbanceModel(shape=Correlated(0.95, 0.95)),
    "`student_t`, 5 (default)": DisturbanceModel(shape=HeavyTailed()),
    "`student_t`, 3": DisturbanceModel(shape=HeavyTailed(3.0)),
}


def run(planner: str, model: DisturbanceModel, episodes: int) -> list[EpisodeResult]:
    """Monte Carlo on the default cut_in."""
    engine = Engine(EpisodeSetup("highway", "cut_in", {}, planner, {}, model, episodes))
    tasks = [EpisodeTask(n, episode_seed(SEED, n), PriorSource()) for n in range(episodes)]
    try:
        return list(engine.run(tasks))
    finally:
        engine.close()


def cells(results: list[EpisodeResult]) -> Iterator[str]:
    """Collisions with their share and its interval [%]; median MinTTC [s]; severity [m²/s²]."""
    if any(each.outcome is Outcome.FAILED for each in results):
        raise SystemExit("There are episodes that could not be run.")
    measures = [each.measures for each in results if each.measures]
    crashes = [each.measures.severity for each in results if each.is_failure and each.measures]
    share = rate(len(crashes), len(results))
    low, high = 100.0 * share.interval.low, 100.0 * share.interval.high
    yield f"{len(crashes)}: {100.0 * share.value:.1f} % [{low:.1f}, {high:.1f}]"
    yield f"{median(m.min_ttc_s for m in measures if m.min_ttc_s is not None):.2f}"
    yield f"{fmean(s for s in crashes if s is not None):.0f}" if crashes else "–"


def main() -> None:
    """The table in Markdown."""
    episodes = int(sys.argv[1]) if len(sys.argv) > 1 else EPISODES
    heads = [
        f"{name}: {what}" for name in PLANNERS for what in ("collisions", "MinTTC", "severity")
    ]
    print("| model |", " | ".join(heads), "|")
    print("|---|" + "---|" * len(heads))
    for name, model in MODELS.items():
        row = [cell for planner in PLANNERS for cell in cells(run(planner, model, episodes))]
        print(f"| {name} |", " | ".join(row), "|", flush=True)


if __name__ == "__main__":
    main()
