"""Figures: how often `rulebook` fails in `highway_drive` under noise on every vehicle, and why."""

from collections import Counter
from collections.abc import Iterator, Sequence
from functools import cache
from itertools import chain

import msgspec
import numpy as np
from benchmarks.episode_pool import EpisodePool, horizon
from benchmarks.figures import Figure
from benchmarks.learning_figures import of_seeds
from benchmarks.samples import COMMAND, share
from benchmarks.truth.mode_agreement import (
    LabelledFailure,
    measure_agreement,
    measure_agreement_of_struck,
)
from benchmarks.truth.undisturbed import UNDISTURBED

from eigenfail import plugins
from eigenfail.values.analysis import AnalysisSettings
from eigenfail.values.channels import Channel
from eigenfail.values.disturbance import DisturbanceModel
from eigenfail.values.episode import EpisodeSetup, EpisodeTask, PriorSource, episode_seed
from eigenfail.values.measures import Measures
from eigenfail.values.records import make_failure_course
from eigenfail_workers.engine import Engine

SCENARIO, PLANNER = "highway_drive", "rulebook"
EPISODES = 60_000
WORSE_EPISODES, WORSE_SCALE = 2_500, 1.25
POINTS = 2_000
BATCH = 50
LEAST_SHARE = 0.1
"""Share of the failures from which a cause counts."""

CAMPAIGNS = 5
MECHANISMS = {"reveal, track lost": "track lost", "cut-in, track lost": "track lost"}
"""Causes in which the same happens to the planner, whichever vehicle it loses."""


class DriveSummary(msgspec.Struct, frozen=True):
    """What is kept of an episode."""

    is_failure: bool
    steps: int
    measures: Measures


def find_p_fail(pool: EpisodePool, seed: int) -> Iterator[tuple[str, Figure]]:
    """P(failure) by Monte Carlo under p(x), and the true causes of the failures.

    p(x) is white noise of the paper's sigma on every vehicle.
    """
    drives = draw(pool, 1.0, EPISODES, seed)
    found = share([one.is_failure for one in drives], describe_causes(drives))
    yield "drive.p_fail", msgspec.structs.replace(found, unit="probability")
    failed = [one for one in drives if one.is_failure]
    causes = Counter(str(one.measures.cause) for one in failed)
    common = [cause for cause, n in causes.items() if n >= LEAST_SHARE * len(failed)]
    yield (
        "drive.labels",
        count(len(common), "causes of 10 % of the failures or more", len(failed), found.note),
    )
    yield from share_causes("drive", drives, "failures under p(x)")
    first = drives[:2_000]
    failures = sum(one.is_failure for one in first)
    yield "drive.mc2000.failures", count(failures, "failures", len(first))
    nearest_m = [one.measures.robustness_m for one in first if not one.is_failure]
    usual_m = float(np.median(nearest_m))
    yield "drive.mc2000.nearest_m", count(usual_m, "m", len(nearest_m))
    others = sum(abs(each_m - usual_m) > 0.001 for each_m in nearest_m)
    note = "drives whose smallest distance differs from the median by more than 1 mm"
    yield "drive.mc2000.other_nearest", count(others, "drives", len(nearest_m), note)


def find_worse(pool: EpisodePool, seed: int) -> Iterator[tuple[str, Figure]]:
    """How often drives fail under noise that is larger than p(x), and the true causes."""
    drives = draw(pool, WORSE_SCALE, WORSE_EPISODES, seed)
    note = f"noise of scale {WORSE_SCALE:g}, not p(x)"
    yield "drive.worse.failure_rate", share([one.is_failure for one in drives], note)
    yield from share_causes("drive.worse", drives, note)


def share_causes(
    prefix: str, drives: Sequence[DriveSummary], note: str
) -> Iterator[tuple[str, Figure]]:
    """Yield the share of the failures that each cause has, and of those that collide late."""
    failed = [one for one in drives if one.is_failure]
    for cause in sorted({str(one.measures.cause) for one in failed}):
        name = cause.replace(", track", "").replace(" ", "_").replace("-", "_")
        yield f"{prefix}.cause.{name}", share([one.measures.cause == cause for one in failed], note)
    yield f"{prefix}.track_lost", share(tell_lost_tracks(drives), note)
    last = 0.9 * horizon(SCENARIO)
    yield f"{prefix}.last_tenth", share([one.steps > last for one in failed], note)


def find_agreement(pool: EpisodePool, seed: int) -> Iterator[tuple[str, Figure]]:
    """Adjusted Rand index of the modes with the true causes, in campaigns of their own seeds.

    With the number of modes found, not given. A cause is the challenge of the vehicle that was
    struck, and whether its track was lost: the vehicle alone is a part of it, and its index is
    therefore measured as well. So is that of the acceleration of the ego alone, also with the three
    mechanisms, since the truck does the same after any lost track.
    """
    found: dict[str, list[float]] = {}
    numbers = []
    for campaign in range(1, CAMPAIGNS + 1):
        failures = collect_failures(pool, seed + campaign)
        numbers.append(len(failures))
        for name, index in compare_features(failures).items():
            found.setdefault(name, []).append(index)
    note = f"; {', '.join(map(str, numbers))} failures under noise of scale {WORSE_SCALE:g}"
    for name, values in found.items():
        yield f"drive.{name}", of_seeds(values, "index", CAMPAIGNS, note)


def compare_features(failures: Sequence[LabelledFailure]) -> dict[str, float]:
    """Return the agreement with the causes by what failures are grouped by."""
    without = [
        msgspec.structs.replace(one, course=msgspec.structs.replace(one.course, end=None))
        for one in failures
    ]
    merged = [
        msgspec.structs.replace(one, cause=MECHANISMS.get(one.cause, one.cause)) for one in without
    ]
    behaviour, noise = (
        AnalysisSettings(features=features, bootstrap=0) for features in ("behaviour", "noise")
    )
    steps = horizon(SCENARIO)
    return {
        "modes_ari": measure_agreement(failures, steps, behaviour),
        "modes_ari.acceleration": measure_agreement(without, steps, behaviour),
        "modes_ari.mechanisms": measure_agreement(merged, steps, behaviour),
        "modes_ari.struck": measure_agreement_of_struck(failures),
        "modes_ari.noise": measure_agreement(failures, steps, noise),
    }


def collect_failures(pool: EpisodePool, seed: int) -> list[LabelledFailure]:
    """Return the failures of a Monte Carlo campaign under noise that is larger than p(x)."""
    tasks = [EpisodeTask(i, episode_seed(seed, i), PriorSource()) for i in range(WORSE_EPISODES)]
    batches = [tasks[first : first + BATCH] for first in range(0, len(tasks), BATCH)]
    return list(chain.from_iterable(pool.each(label_failures, batches)))


def label_failures(tasks: Sequence[EpisodeTask]) -> list[LabelledFailure]:
    """Run episodes in this process, and return those that fail with their causes."""
    failed = [one for one in open_engine(WORSE_SCALE).run(tasks) if one.is_failure]
    return [
        LabelledFailure(
            one.noise.z,
            make_failure_course(one.index, one.scene.dt_s, one.scene.vehicles, one.scene.sizes),
            str(one.measures.cause),
        )
        for one in failed
        if one.scene is not None and one.measures is not None
    ]


def find_undisturbed(pool: EpisodePool, seed: int) -> Iterator[tuple[str, Figure]]:
    """Runs without noise at points that are drawn evenly from the bounds of the parameters."""
    parameters = plugins.load(plugins.SCENARIOS, SCENARIO).Parameters
    (schema,) = msgspec.json.schema(parameters)["$defs"].values()
    bounds = {name: (of["minimum"], of["maximum"]) for name, of in schema["properties"].items()}
    random = np.random.default_rng(seed)
    points = [
        {name: float(random.uniform(low, high)) for name, (low, high) in bounds.items()}
        for _ in range(POINTS)
    ]
    batches = [points[first : first + BATCH] for first in range(0, POINTS, BATCH)]
    drives = list(chain.from_iterable(pool.each(drive_undisturbed, batches)))
    collisions = sum(one.is_failure for one in drives)
    yield "drive.undisturbed", count(collisions, "collisions", len(drives))
    nearest_m = min(one.measures.robustness_m for one in drives)
    yield "drive.undisturbed.nearest_m", count(nearest_m, "m", len(drives))


def draw(pool: EpisodePool, scale: float, n: int, seed: int) -> list[DriveSummary]:
    """Run the first episodes of a Monte Carlo campaign."""
    tasks = [EpisodeTask(i, episode_seed(seed, i), PriorSource()) for i in range(n)]
    batches = [tasks[first : first + BATCH] for first in range(0, n, BATCH)]
    return list(chain.from_iterable(pool.each(drive, [scale] * len(batches), batches)))


def drive(scale: float, tasks: Sequence[EpisodeTask]) -> list[DriveSummary]:
    """Run episodes in this process."""
    return [*run(open_engine(scale), tasks)]


def drive_undisturbed(points: Sequence[dict[str, float]]) -> list[DriveSummary]:
    """Run an episode without noise at each point in this process."""
    engines = (Engine(stage(1.0, point)) for point in points)
    return [drive for engine in engines for drive in run(engine, [UNDISTURBED])]


def run(engine: Engine, tasks: Sequence[EpisodeTask]) -> Iterator[DriveSummary]:
    """Yield what is kept of each episode."""
    for result in engine.run(tasks):
        if result.measures is None:
            raise SystemExit(f"Episode {result.index} failed: {result.fault}.")
        yield DriveSummary(result.is_failure, result.steps, result.measures)


@cache
def open_engine(scale: float) -> Engine:
    """Return the engine of this process for noise on every vehicle."""
    channels = (Channel("every.longitudinal"), Channel("every.lateral"))
    return Engine(stage(scale, {}, channels))


def stage(
    scale: float, parameters: dict[str, float], channels: tuple[Channel, ...] = ()
) -> EpisodeSetup:
    """Return a setup; without channels the noise is on the nearest vehicle."""
    named = {"channels": channels} if channels else {}
    model = DisturbanceModel(scale=scale, **named)
    return EpisodeSetup("highway", SCENARIO, parameters, PLANNER, {}, model, 10**9)


def describe_causes(drives: Sequence[DriveSummary]) -> str:
    """Return how many failures each cause has, the most frequent first."""
    causes = Counter(str(one.measures.cause) for one in drives if one.is_failure)
    return ", ".join(f"{n} of '{cause}'" for cause, n in causes.most_common()) or "no failure"


def tell_lost_tracks(drives: Sequence[DriveSummary]) -> list[bool]:
    """Return for each failure whether the track of the vehicle struck was lost before."""
    causes = [str(one.measures.cause) for one in drives if one.is_failure]
    return [cause.endswith(", track lost") for cause in causes]


def count(value: float, unit: str, n: int, note: str = "") -> Figure:
    """A count or an extreme, which has no interval."""
    return Figure(value=value, unit=unit, n=n, note=note, command=COMMAND)
