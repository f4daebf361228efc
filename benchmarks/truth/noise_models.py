"""Figures: what each disturbance model does to the planners on cut_in."""

from collections.abc import Iterator, Sequence

import msgspec
from benchmarks.episode_loop import tasks
from benchmarks.episode_pool import EpisodePool, EpisodeRecord, make_setup
from benchmarks.figures import Figure
from benchmarks.samples import mean, median, share
from benchmarks.truth.monte_carlo import list_defined

from eigenfail.values.disturbance import DisturbanceModel
from eigenfail.values.shapes import Correlated, HeavyTailed

EPISODES = 400
LONG = 2000
PLANNERS = ("rulebook", "idm")
MODELS = {
    "white": DisturbanceModel(),
    "scale_1.25": DisturbanceModel(scale=1.25),
    "scale_1.5": DisturbanceModel(scale=1.5),
    "scale_2": DisturbanceModel(scale=2.0),
    "ar1_0.5": DisturbanceModel(shape=Correlated(0.5, 0.5)),
    "ar1_0.8": DisturbanceModel(shape=Correlated()),
    "ar1_0.95": DisturbanceModel(shape=Correlated(0.95, 0.95)),
    "student_t_5": DisturbanceModel(shape=HeavyTailed()),
    "student_t_3": DisturbanceModel(shape=HeavyTailed(3.0)),
}


def noise_models(pool: EpisodePool, seed: int) -> Iterator[tuple[str, Figure]]:
    """Failure rate, MinTTC and severity for each model and planner; one model once more, longer."""
    for name, model in MODELS.items():
        for planner in PLANNERS:
            played = under(model, planner, EPISODES, pool, seed)
            yield from figures(f"cut_in.noise.{name}.{planner}", played)
    longer = under(MODELS["ar1_0.8"], "rulebook", LONG, pool, seed)
    crashed = share([one.is_failure for one in longer])
    yield f"cut_in.noise.ar1_0.8.rulebook.mc{LONG}.failure_rate", crashed


def under(
    model: DisturbanceModel, planner: str, episodes: int, pool: EpisodePool, seed: int
) -> list[EpisodeRecord]:
    """Monte Carlo on the default cut_in."""
    setup = msgspec.structs.replace(make_setup("cut_in", planner), disturbance=model)
    return pool.play(setup, tasks(0, episodes, seed))


def figures(place: str, played: Sequence[EpisodeRecord]) -> Iterator[tuple[str, Figure]]:
    """What is told of the episodes under a model; a severity only where anything failed."""
    yield f"{place}.failure_rate", share([one.is_failure for one in played])
    yield f"{place}.median_min_ttc_s", median(list_defined(played, "min_ttc_s"), "s")
    if severities := list_defined(played, "severity"):
        yield f"{place}.mean_severity", mean(severities, "m²/s²")
