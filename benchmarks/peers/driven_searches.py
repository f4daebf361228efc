"""Figures: searches on `highway_drive`, and behind a bridge to SUMO.

The noise of `highway_drive` is white noise of the paper's sigma on every vehicle. All searches
follow the smallest time to collision there, since the smallest distance is that of a passing car
and the same in nearly every drive without a collision. The samplers of Optuna are those of the
method `optuna`; other tools do not run here.
"""

import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import closing, contextmanager
from itertools import chain
from math import log, pi
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

from benchmarks.episode_pool import EpisodePool, horizon
from benchmarks.figures import ROOT, Figure
from benchmarks.learning_figures import of_seeds
from benchmarks.peers.simple_searches import NARROW, describe
from benchmarks.searches import Crash, context, run
from msgspec.structs import replace

from eigenfail.contracts import EpisodeEngine
from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail.values.channels import Channel
from eigenfail.values.disturbance import DisturbanceModel
from eigenfail.values.requirements import COLLISION_ALONE, MeasureLimit
from eigenfail.worlds import resolve_disturbance, world_of
from eigenfail_workers.bridge.connection import SharedConnection
from eigenfail_workers.bridge.engine import BridgeEngine
from eigenfail_workers.engine import Engine

BRIDGE = ROOT / "examples" / "bridge" / "sumo_bridge.py"

OWN: dict[str, tuple[str, dict[str, Any]]] = {
    "held": ("held", {}),
    "cma": ("cma", {}),
    "annealing": ("annealing", {}),
    "annealing_narrow": ("annealing", {**NARROW, "scale": 1.5}),
    "go_explore": ("go_explore", {}),
    "ast": ("ast", {"patience": None}),
    "cem": ("cem", {}),
}
ADAPTED: dict[str, tuple[str, dict[str, Any]]] = {
    "optuna_tpe": ("optuna", {}),
    "optuna_gp": ("optuna", {"sampler": "gp"}),
}
"""Methods of eigenfail and samplers of Optuna, with their settings, by the name in figures.

`annealing_narrow` starts from noise of 1.5 sigma, which is about as likely as noise within the
bounds of Optuna; with 3 sigma, as in the other places, its failures would be far less likely.
"""


class Place(NamedTuple):
    """Where the searches run.

    Attributes:
        spec: a campaign there, whose method and settings are replaced.
        calls: episodes of a campaign.
        channels: channels of the noise.
        package: what must be installed.
        seeds: number of seeds.
        fewer: number of seeds of the searches that have fewer.
    """

    spec: CampaignSpec
    calls: int
    channels: int
    package: str
    seeds: int
    fewer: dict[str, int]


def make_drive() -> CampaignSpec:
    """Return a campaign of `highway_drive` with noise on every vehicle."""
    model = DisturbanceModel(channels=(Channel("every.longitudinal"), Channel("every.lateral")))
    spec = CampaignSpec(
        name="drive",
        method="held",
        episodes=1,
        scenario="highway_drive",
        disturbance=model,
        requirements=COLLISION_ALONE,
        importance=MeasureLimit(measure="min_ttc_s", at_least=0.0),
    )
    return replace(spec, disturbance=resolve_disturbance(spec))


SUMO = CampaignSpec(
    name="sumo",
    method="held",
    episodes=1,
    simulator="bridge",
    scenario="braking_lead",
    planner="ACC",
    scenario_parameters={"steps": 120, "dt_s": 0.1},
)

DRIVEN = {
    # Optuna has 420 values to choose there, and takes longer than the simulation.
    "highway_drive": Place(
        make_drive(), 100, 10, "highway-env", 10, {"optuna_tpe": 5, "optuna_gp": 5}
    ),
    "sumo": Place(SUMO, 100, 2, "libsumo", 5, {}),
}

BOUND = 2.0
"""Bound of the noise of `optuna`, and of that of `ast` [sigma]."""

LEAST_LOG_P = {
    name: -0.5 * place.channels * (log(2.0 * pi) + BOUND**2) for name, place in DRIVEN.items()
}
"""log p per step of noise at the bounds, as that of z. [nat]"""


class DrivenRun(NamedTuple):
    """What came of a campaign.

    Attributes:
        crashed: whether each episode failed.
        crashes: the failures.
        cpu_s: computing time of the process, without that of a bridge. [s]
    """

    crashed: tuple[bool, ...]
    crashes: tuple[Crash, ...]
    cpu_s: float


def compare_driven(
    place: str, name: str, pool: EpisodePool, seed: int
) -> Iterator[tuple[str, Figure]]:
    """Yield the figures of a search."""
    where = DRIVEN[place]
    seeds = range(seed, seed + where.fewer.get(name, where.seeds))
    # One bridge for all campaigns: it takes longer to start than a campaign.
    batches = [seeds] if place == "sumo" else [seeds[i : i + 1] for i in range(len(seeds))]
    found = pool.each(find, [place] * len(batches), [name] * len(batches), batches)
    yield from describe_driven(place, name, list(chain.from_iterable(found)))


def describe_driven(
    place: str, name: str, runs: Sequence[DrivenRun]
) -> Iterator[tuple[str, Figure]]:
    """Yield the figures of a search from its campaigns."""
    calls = DRIVEN[place].calls
    yield from describe(place, name, runs, calls)
    prefix = f"search.{place}.{name}"
    costs = [1e3 * one.cpu_s / calls for one in runs]
    yield f"{prefix}.cpu_ms", of_seeds(costs, "ms", calls, "; computing time per episode")
    if any(one.cause for each in runs for one in each.crashes):
        causes = [float(count_causes(one)) for one in runs]
        yield f"{prefix}.causes", of_seeds(causes, "causes", calls)


def count_causes(found: DrivenRun) -> int:
    """Return the number of distinct true labels of the failures."""
    return len({one.cause for one in found.crashes})


def find(place: str, name: str, seeds: Sequence[int]) -> list[DrivenRun]:
    """Run campaigns in this process."""
    where = DRIVEN[place]
    method, settings = (OWN | ADAPTED)[name]
    shared = replace(where.spec, method=method, settings=settings, episodes=where.calls)
    specs = [replace(shared, seed=seed) for seed in seeds]
    if place == "sumo":
        steps = world_of(where.spec.simulator).find_form(where.spec).steps
        with bridged() as connection:
            return [time_run(one, steps, BridgeEngine(one.setup(), connection)) for one in specs]
    # Engines of their own: policies of earlier campaigns would be in the way of the first ones.
    steps = horizon(where.spec.scenario)
    return [time_run(one, steps, Engine(one.setup())) for one in specs]


def time_run(spec: CampaignSpec, steps: int, engine: EpisodeEngine) -> DrivenRun:
    """Run a campaign in an engine."""
    began_s = time.process_time()
    found = run(spec, context(spec, steps, None), engine)
    return DrivenRun(found.crashed, found.crashes, time.process_time() - began_s)


@contextmanager
def bridged() -> Iterator[SharedConnection]:
    """A connection to a bridge that runs for as long as the block lasts."""
    with TemporaryDirectory() as folder:
        address = f"ipc://{folder}/sumo"
        process = subprocess.Popen([sys.executable, str(BRIDGE), address])
        try:
            with closing(SharedConnection(address)) as connection:
                yield connection
        finally:
            process.terminate()
            process.wait()
