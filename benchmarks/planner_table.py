"""Print the table of docs/planner.md: the rulebook planner, undisturbed, over cut_in's bounds."""

import sys
from collections.abc import Iterator, Sequence
from itertools import pairwise, product

import msgspec
import numpy as np

from eigenfail.values import (
    DisturbanceModel,
    EpisodeSetup,
    EpisodeTask,
    ExplainedEpisode,
    TrajectorySource,
)
from eigenfail_workers.explain import explain
from eigenfail_workers.scenarios.cut_in import DT_S, CutInParameters

COLUMNS = (
    *("`distance_m`", "runs", "collisions", "steps overridden", "QP unsolved"),
    *("acceleration [m/s²]", "largest jerk [m/s³]", "nearest [m]", "smallest MinTTC [s]"),
    *("slowest [m/s]", "way [m]"),
)
UNDISTURBED = EpisodeTask(0, 0, TrajectorySource(np.zeros((0, 2), np.float32)))


def levels() -> dict[str, tuple[float, float, float]]:
    """Smallest, default and largest value of each parameter."""
    (schema,) = msgspec.json.schema(CutInParameters)["$defs"].values()
    return {
        name: (field["minimum"], field["default"], field["maximum"])
        for name, field in schema["properties"].items()
    }


def sweep(distance_m: float) -> Iterator[ExplainedEpisode]:
    """An undisturbed run for each combination of the other parameters' levels."""
    grid = levels() | {"distance_m": (distance_m,)}
    for values in product(*grid.values()):
        parameters = dict(zip(grid, values, strict=True))
        setup = EpisodeSetup("highway", "cut_in", parameters, "rulebook", {}, DisturbanceModel(), 1)
        yield explain(setup, UNDISTURBED)


def row(distance_m: float) -> tuple[str, ...]:
    """The worst over a sweep."""
    runs = list(sweep(distance_m))
    said = [step.account for run in runs for step in run.steps]
    asked = [[step.acceleration_mps2 for step in run.steps] for run in runs]
    jerks = [(b - a) / DT_S for course in asked for a, b in pairwise(course)]
    measures = [run.result.measures for run in runs if run.result.measures]
    poses = [run.result.scene.vehicles[:, 0] for run in runs if run.result.scene]
    ways = [pose[-1, 0] - pose[0, 0] for pose in poses]
    return (
        f"{distance_m:g}",
        str(len(runs)),
        str(sum(run.result.is_failure for run in runs)),
        str(sum(account["override"] != "none" for account in said)),
        str(sum(account["qp_status"] != "solved" for account in said)),
        span([value for course in asked for value in course], 2),
        f"{max(map(abs, jerks)):.1f}",
        f"{min(one.robustness_m for one in measures):.1f}",
        f"{min(one.min_ttc_s for one in measures if one.min_ttc_s is not None):.1f}",
        f"{min(pose[:, 3].min() for pose in poses):.1f}",
        span(ways, 0),
    )


def span(values: Sequence[float], digits: int) -> str:
    """Smallest and largest."""
    return f"{min(values):.{digits}f} … {max(values):.{digits}f}"


def lines(distances_m: Sequence[float]) -> Iterator[str]:
    """The table in Markdown, a row for each distance."""
    yield "| " + " | ".join(COLUMNS) + " |"
    yield "|" + "--:|" * len(COLUMNS)
    for distance_m in distances_m:
        yield "| " + " | ".join(row(distance_m)) + " |"


if __name__ == "__main__":
    wanted = [float(word) for word in sys.argv[1:]] or levels()["distance_m"]
    print("\n".join(lines(wanted)))
