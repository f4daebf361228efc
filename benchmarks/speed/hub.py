"""What the hub can take: results of many workers at once, and many that only say that they live.

`python -m benchmarks.speed.hub` prints both figures, without writing them down.
"""

import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory

import psutil
from benchmarks.figures import ROOT, Figure, show
from sqlalchemy import text

sys.path += [str(ROOT / "tests" / name) for name in ("chaos", "support")]

from stage import Stage
from started import Services, wait_until

COMMAND = "make bench"
RUNS = 3
BUSY = 16
RESULTS, WARM = 20_000, 4_000
"""How many are measured, and before that."""

ROUND = 2_000
"""Episodes in a round: enough that nobody waits for the end of one."""

IDLE = 1_000
IDLE_S = 10.0
PRESENT = text("SELECT count(*) FROM arrivals WHERE left_ms IS NULL")
SETTLING_S = 10.0
"""By then all have come, and are written down."""


def hub_figures() -> dict[str, Figure]:
    """Both figures."""
    rates, cores = [results_per_s() for _ in range(RUNS)], [idle_cores() for _ in range(RUNS)]
    return {
        "hub_results_per_s": figure(rates, "1/s", RESULTS * RUNS, ">= 12000"),
        "hub_idle_1000_core": figure(cores, "cores", RUNS, "<= 0.2"),
    }


def figure(values: Sequence[float], unit: str, n: int, target: str) -> Figure:
    """The middle of some runs."""
    return Figure(
        value=median(values),
        unit=unit,
        n=n,
        spread=(min(values), max(values)),
        target=target,
        command=COMMAND,
    )


def results_per_s() -> float:
    """Results that a services process commits per second, of workers that need no time for one."""
    with playing() as stage:
        services = stage.services()
        settings = {"round_size": ROUND}
        campaign = stage.create(method="monte_carlo", episodes=10**6, settings=settings)
        with run_simulated_workers(services.hub, BUSY):
            stage.wait_for(campaign, WARM)
            began, first = time.perf_counter(), stage.finished(campaign)
            stage.wait_for(campaign, first + RESULTS)
            wall_s, results = time.perf_counter() - began, stage.finished(campaign) - first
    return results / wall_s


def idle_cores() -> float:
    """Share of a core that the services process takes while many workers have nothing to do."""
    with playing() as stage:
        services = stage.services()
        with run_simulated_workers(services.hub, IDLE):
            wait_until(lambda: present(stage) == IDLE, f"{IDLE} workers are there")
            time.sleep(SETTLING_S)
            spent, began = Spent(services), time.perf_counter()
            time.sleep(IDLE_S)
            assert present(stage) == IDLE
            return spent.s() / (time.perf_counter() - began)


def present(stage: Stage) -> int:
    """How many workers are written down as there."""
    return int(stage.ask(PRESENT))


class Spent:
    """Processor time of a services process from now on, without its learners."""

    def __init__(self, services: Services) -> None:
        self._process = psutil.Process(services.process.pid)
        self._before = self._so_far()

    def _so_far(self) -> float:
        times = self._process.cpu_times()
        return float(times.user + times.system)

    def s(self) -> float:
        """Seconds since then."""
        return self._so_far() - self._before


@contextmanager
def run_simulated_workers(
    hub: str, workers: int, episode_s: float = 0.0, **options: float
) -> Iterator[psutil.Process]:
    """Run a number of made-up workers in one process, with options of `simulated_workers.py`."""
    program = [sys.executable, "-m", "benchmarks.speed.simulated_workers"]
    words = [hub, str(workers), str(episode_s)]
    words += [f"--{name}={value}" for name, value in options.items()]
    process = subprocess.Popen(program + words, cwd=ROOT)
    try:
        yield psutil.Process(process.pid)
    finally:
        process.kill()
        process.wait()


@contextmanager
def playing() -> Iterator[Stage]:
    """A stage on SQLite, of which nothing is left."""
    with TemporaryDirectory() as folder:
        stage = Stage(f"sqlite:///{Path(folder) / 'eigenfail.db'}", Path(folder))
        try:
            yield stage
        finally:
            stage.end()


if __name__ == "__main__":
    show(hub_figures())
