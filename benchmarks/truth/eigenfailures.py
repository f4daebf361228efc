"""Figures: whether eigenfailures of campaigns that learnt fail again, over seeds and scenarios.

Each campaign is analysed with the default settings, once with each kind of centre.
"""

from collections.abc import Iterator
from typing import NamedTuple

import msgspec
import numpy as np
from benchmarks.episode_pool import EpisodePool, horizon
from benchmarks.figures import Figure
from benchmarks.searches import engine, search

from eigenfail.values.analysis import AnalysisSettings, Centre
from eigenfail.values.arrays import Floats
from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail.values.episode import EpisodeTask, TrajectorySource, episode_seed
from eigenfail.values.records import Failures
from eigenfail_services.analysis.alignment import EarlyFailures, FailureBatch, gather_failures
from eigenfail_services.analysis.job import analyse_gathered

EPISODES, SEEDS = 400, 20
DISTANCES_M = (58.0, 53.0, 63.0)
"""The scenario of the campaigns, and its neighbours."""

CENTRES: tuple[Centre, ...] = ("median", "mean")
LEARNT = EarlyFailures((1,), {})
COMMAND = "python -m benchmarks.claims"


class Reproduced(NamedTuple):
    """How many eigenfailures of a campaign failed again, of how many, in each scenario."""

    failed: tuple[int, ...]
    modes: int


def reproduce(pool: EpisodePool, seed: int) -> Iterator[tuple[str, Figure]]:
    """Eigenfailures of `ast` on `cut_in` that fail again, in the same scenario and in all three."""
    found = pool.each(reproduce_campaign, range(seed, seed + SEEDS))
    for centre in CENTRES:
        each = [one[centre] for one in found]
        tried = sum(one.modes for one in each)
        same = sum(one.failed[0] for one in each)
        over_all = sum(sum(one.failed) for one in each)
        note = f"{SEEDS} campaigns of {EPISODES} episodes, seeds from {seed}; counts, not a sample"
        for name, failed, replays in (
            ("same_scenario", same, tried),
            ("reproduced_20", over_all, tried * len(DISTANCES_M)),
        ):
            yield (
                f"eigenfailures.{centre}.{name}",
                Figure(
                    value=failed / replays,
                    unit="share",
                    n=replays,
                    command=COMMAND,
                    note=f"{failed} of {replays}; {note}",
                ),
            )


def reproduce_campaign(seed: int) -> dict[Centre, Reproduced]:
    """Run and analyse a campaign, and replay the eigenfailures of each kind of centre."""
    spec = CampaignSpec(name="eigenfailures", method="ast", episodes=EPISODES, seed=seed)
    run = search(spec)
    places = np.flatnonzero(run.crashed).tolist()
    failures = Failures(tuple(places), tuple(one.z for one in run.crashes))
    steps = horizon(spec.scenario)
    found = {}
    for centre in CENTRES:
        asked = AnalysisSettings(bootstrap=0, centre=centre, features="noise")
        gathered = gather_failures([FailureBatch(1, failures)], steps, asked)
        modes = analyse_gathered(gathered, asked, None, {1: EPISODES}, LEARNT).modes
        noise = [mode.eigenfailure for mode in modes]
        failed = tuple(count_failing(spec, distance_m, noise) for distance_m in DISTANCES_M)
        found[centre] = Reproduced(failed, len(modes))
    return found


def count_failing(spec: CampaignSpec, distance_m: float, noise: list[Floats]) -> int:
    """Count noise trajectories that fail at a distance."""
    there = msgspec.structs.replace(spec, scenario_parameters={"distance_m": distance_m})
    tasks = [
        EpisodeTask(index, episode_seed(spec.seed, index), TrajectorySource(z))
        for index, z in enumerate(noise)
    ]
    results = engine(msgspec.json.encode(there.setup())).run(tasks)
    return sum(result.is_failure for result in results)
