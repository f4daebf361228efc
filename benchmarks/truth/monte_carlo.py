"""Figures: the planners under the disturbance model itself, in the episodes of a campaign."""

from collections.abc import Iterator, Sequence

from benchmarks.episode_loop import tasks
from benchmarks.episode_pool import EpisodePool, EpisodeRecord, make_setup
from benchmarks.figures import Figure
from benchmarks.samples import COMMAND, mean, median, share

EPISODES = 2000


def calm(scenario: str, pool: EpisodePool, seed: int) -> Iterator[tuple[str, Figure]]:
    """`rulebook`: it must not fail, and must not come near to it."""
    place, runs = (
        f"{scenario}.rulebook.mc{EPISODES}",
        run_first_episodes(scenario, "rulebook", pool, seed),
    )
    yield from failures(place, runs)
    yield f"{place}.median_min_ttc_s", median(list_defined(runs, "min_ttc_s"), "s")
    yield f"{place}.median_drac", median(list_defined(runs, "max_drac_mps2"), "m/s²")
    yield f"{place}.track_lost", share([one.lost_tracks > 0 for one in runs])


def frail(scenario: str, pool: EpisodePool, seed: int) -> Iterator[tuple[str, Figure]]:
    """`idm`: it must fail, so that noise matters."""
    place, runs = f"{scenario}.idm.mc{EPISODES}", run_first_episodes(scenario, "idm", pool, seed)
    yield from failures(place, runs)
    yield f"{place}.mean_severity", mean(list_defined(runs, "severity"), "m²/s²")


def run_first_episodes(
    scenario: str, planner: str, pool: EpisodePool, seed: int
) -> list[EpisodeRecord]:
    """The first episodes of the Monte Carlo campaign of this seed."""
    return pool.play(make_setup(scenario, planner), tasks(0, EPISODES, seed))


def failures(place: str, runs: Sequence[EpisodeRecord]) -> Iterator[tuple[str, Figure]]:
    """How many, and their rate."""
    crashed = [one.is_failure for one in runs]
    yield (
        f"{place}.failures",
        Figure(value=sum(crashed), unit="episodes", n=len(runs), command=COMMAND),
    )
    yield f"{place}.failure_rate", share(crashed)


def list_defined(runs: Sequence[EpisodeRecord], measure: str) -> list[float]:
    """A measure over the episodes in which it was defined."""
    values = [getattr(one.measures, measure) for one in runs]
    return [value for value in values if value is not None]
