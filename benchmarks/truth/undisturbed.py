"""Figures: the planners without noise, over the bounds of a scenario's parameters.

Every combination of smallest, default and largest value of each parameter is run once, with the
default durations and the default braking.
"""

from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from itertools import pairwise, product

import msgspec
import numpy as np
from benchmarks.episode_pool import EpisodePool, make_setup
from benchmarks.figures import Figure
from benchmarks.samples import COMMAND

from eigenfail import plugins
from eigenfail.values.episode import EpisodeSetup, EpisodeTask, TrajectorySource
from eigenfail.values.proof import ExplainedEpisode
from eigenfail_workers.explain import explain

UNDISTURBED = EpisodeTask(0, 0, TrajectorySource(np.zeros((0, 2), np.float32)))
FIXED = {"dt_s", "duration_s", "peak_braking_mps2"}
"""Parameters that keep their defaults."""
CALM = ("override", "none"), ("qp_status", "solved")
"""What `rulebook` tells of a step that goes as planned."""

UNLIT = {"brake_lights": {"lit_from_mps2": 10.0}}
"""With these settings `rulebook` sees no brake lights."""


class Drive(msgspec.Struct, frozen=True):
    """A run without noise, in the numbers that are told of it."""

    collided: bool
    nearest_m: float
    min_ttc_s: float | None
    hardest_braking_mps2: float
    largest_jerk_mps3: float
    slowest_mps: float
    steps_not_as_planned: int
    lost_tracks: float
    changed_lane: bool


def undisturbed(
    scenario: str, planner: str, pool: EpisodePool, _seed: int
) -> Iterator[tuple[str, Figure]]:
    """The worst over the bounds; there is no noise, and so no seed."""
    yield from worst(f"{scenario}.{planner}.undisturbed", swept(pool, scenario, planner))


def unlit(pool: EpisodePool, _seed: int) -> Iterator[tuple[str, Figure]]:
    """`rulebook` behind a braking car whose brake lights it does not see."""
    drives = swept(pool, "lead_brake", "rulebook", UNLIT)
    crashed = [one for one in drives if one.collided]
    n, place = len(drives), "lead_brake.rulebook.unlit"
    yield f"{place}.collisions", number(len(crashed), "runs", n)
    lost = sum(one.lost_tracks > 0 for one in crashed)
    yield f"{place}.collisions_after_a_lost_track", number(lost, "runs", n)


def swept(
    pool: EpisodePool, scenario: str, planner: str, settings: Mapping[str, object] | None = None
) -> list[Drive]:
    """A run at each point of the grid."""
    setups = [
        msgspec.structs.replace(
            make_setup(scenario, planner, **parameters), planner_settings=settings or {}
        )
        for parameters in grid(scenario)
    ]
    return pool.each(drive, map(msgspec.json.encode, setups))


def grid(scenario: str) -> Iterator[dict[str, float]]:
    """Smallest, default and largest value of each parameter but `FIXED`, in all combinations."""
    parameters = plugins.load(plugins.SCENARIOS, scenario).Parameters
    (schema,) = msgspec.json.schema(parameters)["$defs"].values()
    fields = {n: field for n, field in schema["properties"].items() if n not in FIXED}
    levels = [(field["minimum"], field["default"], field["maximum"]) for field in fields.values()]
    return (dict(zip(fields, values, strict=True)) for values in product(*levels))


def drive(setup: bytes) -> Drive:
    """Run a setup in JSON once, in this process."""
    return read_account(explain(msgspec.json.decode(setup, type=EpisodeSetup), UNDISTURBED))


def read_account(run: ExplainedEpisode) -> Drive:
    """What is kept of a run."""
    measures, scene = run.result.measures, run.result.scene
    if measures is None or scene is None:
        raise SystemExit(f"A run without noise failed: {run.result.fault}.")
    asked = [step.acceleration_mps2 for step in run.steps]
    step_s = run.steps[1].time_s - run.steps[0].time_s
    strange = [any(s.account.get(key, usual) != usual for key, usual in CALM) for s in run.steps]
    return Drive(
        collided=run.result.is_failure,
        nearest_m=measures.robustness_m,
        min_ttc_s=measures.min_ttc_s,
        hardest_braking_mps2=-min(asked),
        largest_jerk_mps3=max(abs(b - a) for a, b in pairwise(asked)) / step_s,
        slowest_mps=float(scene.vehicles[:, 0, 3].min()),
        steps_not_as_planned=sum(strange),
        lost_tracks=float(run.steps[-1].account.get("lost_tracks", 0.0)),
        changed_lane=bool(scene.vehicles[-1, 0, 1] > scene.sizes[0, 1] / 2.0),
    )


def worst(place: str, drives: Sequence[Drive]) -> Iterator[tuple[str, Figure]]:
    """Of each number the worst."""
    of = partial(number, n=len(drives))
    times_s = [one.min_ttc_s for one in drives if one.min_ttc_s is not None]
    yield f"{place}.runs", of(len(drives), "runs")
    yield f"{place}.collisions", of(sum(one.collided for one in drives), "runs")
    yield f"{place}.nearest_m", of(min(one.nearest_m for one in drives), "m")
    yield f"{place}.min_ttc_s", of(min(times_s, default=None), "s")
    braking = max(one.hardest_braking_mps2 for one in drives)
    yield f"{place}.hardest_braking", of(braking, "m/s²")
    yield f"{place}.largest_jerk", of(max(one.largest_jerk_mps3 for one in drives), "m/s³")
    yield f"{place}.slowest_mps", of(min(one.slowest_mps for one in drives), "m/s")
    strange = sum(one.steps_not_as_planned for one in drives)
    yield f"{place}.steps_not_as_planned", of(strange, "steps")
    yield f"{place}.changed_lane", of(sum(one.changed_lane for one in drives), "runs")


def number(value: float | None, unit: str, n: int) -> Figure:
    """A count or an extreme, which has no interval."""
    return Figure(value=value, unit=unit, n=n, command=COMMAND)
