"""Print the first table of benchmarks/performance.md: where the time of an episode goes.

Timers stand around the parts of Monte Carlo episodes on cut_in; each keeps the time that was its
own: what a part calls that is a part itself is counted there. Timers cannot be put
around compiled functions: it is interpreted. `episode_profile.py [EPISODES]`.
"""

import json
import os
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator
from functools import partial
from importlib import import_module
from typing import Any

from benchmarks.figures import ROOT

from eigenfail.processes import NUMERIC_ENVIRONMENT
from eigenfail_workers.compilation import INTERPRETED_VARIABLE

EPISODES = 200
RUNS = 3
WARM_UP = 5
SEED = 6
COLUMNS = ("part", "calls per step", "µs per step", "share", "what it is")
OSQP = "OSQP itself"

WORKERS = "eigenfail_workers"
RULEBOOK = f"{WORKERS}.planners.rulebook"
PARTS: dict[str, tuple[tuple[str, tuple[str, ...]], ...]] = {
    "simulator": ((f"{WORKERS}.simulators.scripted_world:ScriptedWorld", ("reset", "advance")),),
    "planner": ((f"{RULEBOOK}.planner:Rulebook", ("reset", "act")),),
    "quadratic program": ((f"{RULEBOOK}.quadratic_program:QuadraticProgram", ("reset", "solve")),),
    "closed loop": ((f"{WORKERS}.closed_loop:DrivenSimulation", ("reset", "step")),),
    "noise": (
        (f"{WORKERS}.noise.deviations:Deviations", ("compute",)),
        (f"{WORKERS}.noise.sources", ("begin",)),
        (f"{WORKERS}.noise.sources:TrajectoryNoise", ("draw",)),
        ("eigenfail.values.disturbance:Conversion", ("inject",)),
    ),
    "measures": (
        (f"{WORKERS}.measures.recorder:Recorder", ("observe", "add_disturbance", "measures")),
    ),
    "arrays of the result": ((f"{WORKERS}.measures.recorder:Recorder", ("noise", "scene")),),
    "rest": ((f"{WORKERS}.engine:Engine", ("_run",)),),
}
MEANING = {
    "simulator": "the truck's motion, the collision test; the actors' script",
    "planner": "tracker, intent, candidates, rules, steering; filling the program's vectors",
    "quadratic program": "checks, handing over to OSQP, reading its answer",
    OSQP: "what OSQP reports as its own run time",
    "closed loop": "perception, limits of the truck, observations",
    "noise": "sigma, z, metres",
    "measures": "distance between footprints, time to collision, DRAC, ride",
    "arrays of the result": (
        "noise of each episode as arrays; the scene of every 50th and of failures"
    ),
    "rest": "the loop itself",
}


class Clock:
    """Own times and calls of the parts; the innermost running part is the last on the stack."""

    def __init__(self) -> None:
        self.own_s: Counter[str] = Counter()
        self.calls: Counter[str] = Counter()
        self._inner_s: list[float] = [0.0]

    def run(self, part: str, function: Callable[..., Any], *arguments: Any, **named: Any) -> Any:
        """Call it, and count its time less that of the parts within."""
        self._inner_s.append(0.0)
        began = time.perf_counter()
        result = function(*arguments, **named)
        took_s = time.perf_counter() - began
        inside_s = self._inner_s.pop()
        osqp_s = arguments[0].run_s if function.__name__ == "solve" else 0.0
        self._inner_s[-1] += took_s
        self.own_s[part] += took_s - inside_s - osqp_s
        self.own_s[OSQP] += osqp_s
        self.calls[part] += 1
        self.calls[OSQP] += osqp_s > 0.0
        return result


class Timed:
    """Stands in for a function or a method."""

    def __init__(self, clock: Clock, part: str, function: Callable[..., Any]) -> None:
        self._run = partial(clock.run, part, function)

    def __get__(self, instance: object, owner: type) -> Callable[..., Any]:
        return partial(self._run, instance)

    def __call__(self, *arguments: Any, **named: Any) -> Any:
        return self._run(*arguments, **named)


def put_up(clock: Clock) -> None:
    """Put timers around all parts."""
    for part, places in PARTS.items():
        for place, names in places:
            module, _, name = place.partition(":")
            owner = getattr(import_module(module), name) if name else import_module(module)
            for function in names:
                setattr(owner, function, Timed(clock, part, getattr(owner, function)))


def measure(episodes: int, timed: bool) -> dict[str, Any]:
    """Seconds of the loop, and with timers the parts' own, in a process of its own."""
    from benchmarks.episode_loop import tasks

    from eigenfail.values.campaign_spec import CampaignSpec
    from eigenfail_workers.engine import Engine

    clock = Clock()
    if timed:
        put_up(clock)
    spec = CampaignSpec(name="profile", method="monte_carlo", episodes=episodes, seed=SEED)
    engine = Engine(spec.setup())
    list(engine.run(tasks(0, WARM_UP, SEED)))
    clock.own_s.clear(), clock.calls.clear()
    began = time.perf_counter()
    steps = sum(result.steps for result in engine.run(tasks(WARM_UP, episodes, SEED)))
    total_s = time.perf_counter() - began
    return {"total_s": total_s, "steps": steps, "own_s": clock.own_s, "calls": clock.calls}


def calmest(episodes: int, how: str) -> dict[str, Any]:
    """`measure` in processes of their own; the one that the machine disturbed least."""
    return min((apart(episodes, how) for _ in range(RUNS)), key=lambda found: found["total_s"])


def apart(episodes: int, how: str) -> dict[str, Any]:
    """`measure`, where nothing else was loaded or timed before."""
    command = [sys.executable, "-m", "benchmarks.speed.episode_profile", str(episodes), how]
    environment = os.environ | NUMERIC_ENVIRONMENT | {INTERPRETED_VARIABLE: "1"}
    done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, check=True)
    found: dict[str, Any] = json.loads(done.stdout)
    return found


def lines(episodes: int) -> Iterator[str]:
    """The table in Markdown, and what the timers themselves cost."""
    timed, bare = calmest(episodes, "timed"), calmest(episodes, "bare")
    steps, own_s = timed["steps"], timed["own_s"]
    yield "| " + " | ".join(COLUMNS) + " |"
    yield "|---|--:|--:|--:|---|"
    for part, meaning in MEANING.items():
        share = own_s[part] / timed["total_s"]
        calls, each_us = timed["calls"][part] / steps, 1e6 * own_s[part] / steps
        yield f"| {part} | {calls:.2f} | {each_us:.1f} | {share:.0%} | {meaning} |"
    each_us = 1e6 * timed["total_s"] / steps
    yield f"| all | | {each_us:.1f} | 100% | without timers {1e6 * bare['total_s'] / steps:.1f} |"


if __name__ == "__main__":
    wanted, how = int((*sys.argv, EPISODES)[1]), (*sys.argv[2:], "")[0]
    if how:
        print(json.dumps(measure(wanted, timed=how == "timed")))
    else:
        print("\n".join(lines(wanted)))
