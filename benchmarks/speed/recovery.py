"""What faults cost: episodes that are run twice, and the time until work goes on.

The processes are real, and so are their deaths; what is run is a function that takes 20 ms and
counts how often it is called.
"""

import os
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import cycle
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory

from benchmarks.figures import ROOT, Figure
from benchmarks.speed.counting_function import COUNTS

from eigenfail.functions import ALLOWED_VARIABLE

sys.path += [str(ROOT / "tests" / name) for name in ("chaos", "support")]

from stage import Stage

COMMAND = "make bench"
WORKERS = 2
KILL_EVERY_S = 3.0
KILLS = 20
CRASHES = 5
MANY = 1_000_000
WARM = 100
"""Results after which all are at work."""

FUNCTION = {
    "simulator": "function",
    "scenario": "function",
    "scenario_parameters": {"steps": 5},
    "planner": "counting_function:robustness",
    "method": "monte_carlo",
}


def recovery_figures() -> dict[str, Figure]:
    """Both figures."""
    return {"kill_extra_work": extra_work(), "recovery_s": recovery()}


def extra_work() -> Figure:
    """Episodes that were run for each one that was kept, while workers are killed."""
    with playing() as stage:
        stage.services()
        calls = Path(os.environ[COUNTS])
        workers = [stage.worker() for _ in range(WORKERS)]
        campaign = stage.create(**FUNCTION, episodes=MANY)
        stage.wait_for(campaign, WARM)
        run, kept = calls.stat().st_size, stage.finished(campaign)
        for place, _ in zip(cycle(range(WORKERS)), range(KILLS), strict=False):
            time.sleep(KILL_EVERY_S)
            workers[place].kill()
            workers[place] = stage.worker()
        run, kept = calls.stat().st_size - run, stage.finished(campaign) - kept
    return Figure(
        value=run / kept,
        unit="ratio",
        n=kept,
        target="<= 1.10",
        note=f"{KILLS} kills of {WORKERS} workers, one every {KILL_EVERY_S:g} s",
        command=COMMAND,
    )


def recovery() -> Figure:
    """From kill -9 of the services, which are started again, to the first new result. [s]"""
    with playing() as stage:
        services = stage.services()
        for _ in range(WORKERS):
            stage.worker()
        campaign = stage.create(**FUNCTION, episodes=MANY)
        times = []
        for _ in range(CRASHES):
            stage.wait_for(campaign, stage.finished(campaign) + WARM)
            began = time.monotonic()
            services.kill()
            kept = stage.finished(campaign)
            services = stage.services()
            stage.wait_for(campaign, kept + 1)
            times.append(time.monotonic() - began)
    return Figure(
        value=median(times),
        unit="s",
        n=len(times),
        spread=(min(times), max(times)),
        target="<= 5",
        note="the start of the new process included",
        command=COMMAND,
    )


@contextmanager
def playing() -> Iterator[Stage]:
    """A stage whose processes find the function, and where to count its calls."""
    with TemporaryDirectory() as folder:
        os.environ |= {
            "PYTHONPATH": str(ROOT / "benchmarks" / "speed"),
            COUNTS: str(Path(folder) / "calls"),
        }
        os.environ[ALLOWED_VARIABLE] = "counting_function"
        stage = Stage(f"sqlite:///{Path(folder) / 'eigenfail.db'}", Path(folder))
        try:
            yield stage
        finally:
            stage.end()
