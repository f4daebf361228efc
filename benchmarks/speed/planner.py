"""What one decision of the rulebook planner costs, and what its quadratic program costs in it.

Interpreted: compiled methods cannot be watched.
"""

import json
import os
import subprocess
import sys
import time
from collections.abc import Callable
from functools import partial
from statistics import median

import numpy as np
from benchmarks.figures import ROOT, Figure

from eigenfail.processes import NUMERIC_ENVIRONMENT
from eigenfail_workers.compilation import INTERPRETED_VARIABLE
from eigenfail_workers.planners.rulebook.quadratic_program import QuadraticProgram, Vector

COMMAND = "make bench"
EPISODES = 60
SEED = 4
PLANNER = "eigenfail_workers.planners.rulebook"


class Watched:
    """Stands in for a method: calls it, and keeps how long it took.

    Attributes:
        runs_s: of each call on a quadratic program, the time that OSQP reports.
        vectors: of each call on a quadratic program, that program and copies of its vectors.
    """

    def __init__(self, function: Callable[..., object]) -> None:
        self.function = function
        self.times_s: list[float] = []
        self.vectors: list[tuple[QuadraticProgram, list[Vector]]] = []
        self.runs_s: list[float] = []

    def __get__(self, instance: object, owner: type) -> Callable[..., object]:
        return partial(self, instance)

    def __call__(self, *arguments: object) -> object:
        if isinstance(arguments[0], QuadraticProgram):
            program = arguments[0]
            vectors = [v.copy() for v in (program.linear, program.lower, program.upper)]
            self.vectors.append((program, vectors))
        before = time.perf_counter()
        result = self.function(*arguments)
        self.times_s.append(time.perf_counter() - before)
        if isinstance(arguments[0], QuadraticProgram):
            self.runs_s.append(arguments[0].run_s)
        return result


def watch() -> tuple[Watched, Watched]:
    """Monte Carlo episodes on cut_in, with every decision and every program watched."""
    from benchmarks.episode_loop import tasks

    from eigenfail.values.campaign_spec import CampaignSpec
    from eigenfail_workers.engine import Engine
    from eigenfail_workers.planners.rulebook.planner import Rulebook

    act, solve = Watched(Rulebook.act), Watched(QuadraticProgram.solve)
    Rulebook.act = act  # type: ignore[assignment,method-assign]
    QuadraticProgram.solve = solve  # type: ignore[assignment,method-assign]
    spec = CampaignSpec(name="plan", method="monte_carlo", episodes=EPISODES, seed=SEED)
    list(Engine(spec.setup()).run(tasks(0, EPISODES, SEED)))
    return act, solve


def fresh_over_warm(solve: Watched) -> float:
    """Solving each program after setting it up afresh ÷ after updating the one before."""
    fresh_s, warm_s = 0.0, 0.0
    for program, vectors in solve.vectors[:2000]:
        program.linear[:], program.lower[:], program.upper[:] = vectors
        before = time.perf_counter()
        solve.function(program)
        between = time.perf_counter()
        program.set_up()
        solve.function(program)
        warm_s += between - before
        fresh_s += time.perf_counter() - between
    return fresh_s / warm_s


def measure() -> dict[str, float]:
    """Everything, in a process of its own."""
    act, solve = watch()
    return {
        "plan_p50_ms": 1000 * float(np.quantile(act.times_s, 0.5)),
        "plan_p99_ms": 1000 * float(np.quantile(act.times_s, 0.99)),
        "qp_wall_over_osqp": float(np.median(np.divide(solve.times_s, solve.runs_s))),
        "qp_setup_over_warm": fresh_over_warm(solve),
    }


TARGETS = {
    "plan_p50_ms": ("ms", "<= 1.0"),
    "plan_p99_ms": ("ms", "<= 3.0"),
    "qp_wall_over_osqp": ("ratio", "<= 1.5"),
    "qp_setup_over_warm": ("ratio", ">= 3"),
}
RUNS = 3


def planner_figures() -> dict[str, Figure]:
    """The middle of three runs."""
    command = [sys.executable, "-m", "benchmarks.speed.planner"]
    environment = os.environ | NUMERIC_ENVIRONMENT | {INTERPRETED_VARIABLE: "1"}
    runs = [
        json.loads(
            subprocess.run(
                command, cwd=ROOT, env=environment, capture_output=True, check=True
            ).stdout
        )
        for _ in range(RUNS)
    ]
    return {
        name: Figure(
            value=median(run[name] for run in runs),
            unit=unit,
            n=RUNS,
            spread=(min(run[name] for run in runs), max(run[name] for run in runs)),
            target=target,
            command=COMMAND,
        )
        for name, (unit, target) in TARGETS.items()
    }


if __name__ == "__main__":
    print(json.dumps(measure()))
