"""Figures: the planners in `merge_in` and `lead_brake`, under ordinary noise and held noise."""

from collections.abc import Iterator

import msgspec
import numpy as np
from benchmarks.episode_loop import tasks
from benchmarks.episode_pool import EpisodePool, horizon, make_setup
from benchmarks.figures import Figure
from benchmarks.samples import mean, median, share
from benchmarks.truth.monte_carlo import list_defined
from benchmarks.truth.shapes import draw_held_noise
from benchmarks.truth.undisturbed import number

from eigenfail import plugins
from eigenfail.values.episode import EpisodeResult, EpisodeSetup, EpisodeTask
from eigenfail_workers.engine import Engine

EPISODES, HELD = 300, 100
BATCH = 20


class Merge(msgspec.Struct, frozen=True):
    """Of an episode in `merge_in`: when the truck crossed the marking, and how near it came.

    `crossed_s` is None where it did not; `ahead` is whether it ended ahead of the second car.
    """

    crossed_s: float | None
    ahead: bool
    robustness_m: float
    is_failure: bool


def held_noise(
    scenario: str, planner: str, pool: EpisodePool, seed: int
) -> Iterator[tuple[str, Figure]]:
    """Uniform noise of ±3 sigma, each value held for 5 steps: crashes, severity, tracks lost."""
    noise = draw_held_noise(np.random.default_rng(seed), HELD, horizon(scenario), sigma=3.0, hold=5)
    played = pool.inject(make_setup(scenario, planner), noise)
    crashed = [one for one in played if one.is_failure]
    place = f"{scenario}.{planner}.held3"
    yield f"{place}.rate", share([one.is_failure for one in played])
    if crashed:
        yield f"{place}.mean_severity", mean(list_defined(crashed, "severity"), "m²/s²")
    if planner == "rulebook":
        after = share([one.lost_tracks > 0 for one in crashed], "of the crashes")
        yield f"{place}.crashes_after_a_lost_track", after


def ordinary(
    scenario: str, planner: str, pool: EpisodePool, seed: int
) -> Iterator[tuple[str, Figure]]:
    """The first episodes of a Monte Carlo campaign: how many fail, and the nearest of all."""
    played = pool.play(make_setup(scenario, planner), tasks(0, EPISODES, seed))
    place = f"{scenario}.{planner}.mc{EPISODES}"
    yield f"{place}.failure_rate", share([one.is_failure for one in played])
    nearest_m = min(one.measures.robustness_m for one in played)
    yield f"{place}.nearest_m", number(nearest_m, "m", EPISODES)


def merges(planner: str, pool: EpisodePool, seed: int) -> Iterator[tuple[str, Figure]]:
    """When the truck crosses the marking under ordinary noise, and how near it comes."""
    setup = msgspec.json.encode(
        msgspec.structs.replace(make_setup("merge_in", planner), scene_every=1)
    )
    every = tasks(0, EPISODES, seed)
    batches = [every[first : first + BATCH] for first in range(0, EPISODES, BATCH)]
    found = [
        one for batch in pool.each(run_in_process, [setup] * len(batches), batches) for one in batch
    ]
    place = f"merge_in.{planner}.merges"
    times_s = [one.crossed_s for one in found if one.crossed_s is not None]
    distances_m = [one.robustness_m for one in found]
    yield f"{place}.median_crossing_s", median(times_s, "s")
    late_s = [one.crossed_s for one in found if one.is_failure and one.crossed_s is not None]
    if late_s:
        yield f"{place}.median_crossing_before_a_crash_s", median(late_s, "s")
    yield f"{place}.ahead", share([one.ahead for one in found])
    yield f"{place}.nearest_m", number(min(distances_m), "m", EPISODES)
    yield f"{place}.median_robustness_m", median(distances_m, "m")
    yield f"{place}.different_robustness", number(len(set(distances_m)), "episodes", EPISODES)


def run_in_process(setup: bytes, batch: list[EpisodeTask]) -> list[Merge]:
    """Run episodes in this process."""
    engine = Engine(msgspec.json.decode(setup, type=EpisodeSetup))
    try:
        return [merge(result) for result in engine.run(batch)]
    finally:
        engine.close()


def merge(result: EpisodeResult) -> Merge:
    """Of an episode whose whole scene was kept."""
    if result.scene is None or result.measures is None:
        raise SystemExit(f"Episode {result.index} failed: {result.fault}.")
    situation = plugins.load(plugins.SCENARIOS, "merge_in")
    mission = situation()(situation.Parameters(), 0).mission
    across_m, along_m = result.scene.vehicles[:, 0, 1], result.scene.vehicles[:, :, 0]
    beyond = np.flatnonzero(across_m > 0.5 * mission.lane_width_m)
    ended_m = along_m[-1]
    return Merge(
        crossed_s=float(beyond[0]) * mission.dt_s if len(beyond) else None,
        ahead=bool(len(beyond) and ended_m[0] > ended_m[2]),
        robustness_m=result.measures.robustness_m,
        is_failure=result.is_failure,
    )
