"""How long an analysis takes, and how much memory, each in a process of its own.

The failures are written into a fresh SQLite store, and the product's own analysis reads them there.
`python -m benchmarks.speed.analysis` tells the figures.
"""

import os
import resource
import subprocess
import sys
import time
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory

import msgspec
import numpy as np
from benchmarks.figures import ROOT, Figure, show
from sqlalchemy import create_engine, insert

from eigenfail.processes import NUMERIC_ENVIRONMENT
from eigenfail.values.analysis import AnalysisSettings
from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail.values.episode import Outcome
from eigenfail_services.campaigns.analysis_jobs import run_analysis
from eigenfail_services.campaigns.validation import check_spec
from eigenfail_services.store.schema import campaigns, episodes, trajectories
from eigenfail_services.store.store import open_store

COMMAND = "make bench"
FEW, MANY = 300, 100_000
STEPS = 100
MODES = 3
RUNS = 3
BATCH = 2_000
LEAST_STEPS = 60
MEBI = 1024.0


class Taken(msgspec.Struct, frozen=True):
    """What an analysis took: wall time, and the largest resident memory of its process. [s, MiB]"""

    wall_s: float
    memory_mb: float
    failures: int


def analysis_figures() -> dict[str, Figure]:
    """Of 300 failures without the bootstrap, and of 100,000 with it."""
    with TemporaryDirectory() as folder:
        few = measure_analysis(Path(folder) / "few.db", FEW, bootstrap=0, runs=RUNS)
        many = measure_analysis(
            Path(folder) / "many.db", MANY, bootstrap=AnalysisSettings().bootstrap
        )
    return {
        "analysis_300_s": figure([one.wall_s for one in few], "s", "<= 2"),
        "analysis_1e5_s": figure([one.wall_s for one in many], "s", "<= 60"),
        "analysis_1e5_mb": figure([one.memory_mb for one in many], "MiB", "<= 1024"),
    }


def measure_analysis(path: Path, count: int, bootstrap: int, runs: int = 1) -> list[Taken]:
    """Fill a store, and analyse it a few times."""
    fill(path, count)
    return [in_a_process_of_its_own(path, bootstrap) for _ in range(runs)]


def in_a_process_of_its_own(path: Path, bootstrap: int) -> Taken:
    """An analysis of what is in a store, as a supervisor would have it done."""
    command = [sys.executable, "-m", "benchmarks.speed.analysis", str(path), str(bootstrap)]
    done = subprocess.run(
        command,
        cwd=ROOT,
        capture_output=True,
        check=True,
        env=os.environ | NUMERIC_ENVIRONMENT,
    )
    return msgspec.json.decode(done.stdout, type=Taken)


def fill(path: Path, count: int) -> None:
    """A campaign with so many failures, of three modes, and of differing lengths."""
    store = open_store(f"sqlite:///{path}")
    spec = CampaignSpec(name="analysis", method="monte_carlo", episodes=count)
    campaign = store.campaigns.create(check_spec(spec)).id
    store.close()
    engine = create_engine(f"sqlite:///{path}")
    with engine.begin() as connection:
        connection.execute(campaigns.update().values(completed=count, failures=count))
        for rows in batches(campaign, count):
            connection.execute(insert(episodes), [row for row, _ in rows])
            connection.execute(insert(trajectories), [blobs for _, blobs in rows])
    engine.dispose()


def batches(campaign: int, count: int) -> Iterator[list[tuple[dict[str, object], ...]]]:
    """Rows of episodes and of trajectories."""
    generator = np.random.default_rng(0)
    for first in range(0, count, BATCH):
        yield [
            (episode(campaign, index, len(z)), trajectory(campaign, index, z))
            for index, z in enumerate(failing(generator, min(BATCH, count - first)), first)
        ]


def failing(generator: np.random.Generator, count: int) -> list[np.ndarray]:
    """Noise of some failures."""
    z = generator.standard_normal((count, STEPS, 2)).astype(np.float32)
    modes, lengths = (
        generator.integers(0, MODES, count),
        generator.integers(LEAST_STEPS, STEPS, count),
    )
    for row, mode in zip(z, modes.tolist(), strict=True):
        row[10 + 15 * mode : 25 + 15 * mode, mode % 2] += 1.5 * (-1.0) ** mode
    return [row[:steps] for row, steps in zip(z, lengths.tolist(), strict=True)]


def episode(campaign: int, index: int, steps: int) -> dict[str, object]:
    """The row of a collision."""
    return {
        "campaign": campaign,
        "index": index,
        "seed": index,
        "outcome": Outcome.COLLISION,
        "steps": steps,
        "source": "prior",
        "worker": "benchmark",
        "robustness_m": 0.0,
        "log_probability": 0.0,
        "wall_s": 0.0,
        "finished_ms": 0,
        "digest": str(index),
        "has_scene": False,
    }


def trajectory(campaign: int, index: int, z: np.ndarray) -> dict[str, object]:
    """Its noise."""
    return {"campaign": campaign, "index": index, "z": z.tobytes(), "sigma": z.tobytes()}


def take(path: str, bootstrap: int) -> Taken:
    """Analyse what is in a store, in this process; loading scikit-learn is no part of the time."""
    import_module("eigenfail_services.analysis.job")
    store = open_store(f"sqlite:///{path}")
    analysis = store.analyses.create(1, AnalysisSettings(bootstrap=bootstrap, features="noise")).id
    before = time.perf_counter()
    run_analysis(store, analysis)
    wall_s = time.perf_counter() - before
    found = store.analyses.get(analysis)
    if found.result is None:
        raise SystemExit(found.problem)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / MEBI
    return Taken(wall_s, peak, len(found.result.episodes))


def figure(values: list[float], unit: str, target: str) -> Figure:
    """The middle of some runs."""
    spread = (min(values), max(values))
    return Figure(
        value=median(values),
        unit=unit,
        n=len(values),
        spread=spread,
        target=target,
        command=COMMAND,
    )


def main(words: list[str]) -> None:
    """Tell the figures; with a store's path and a number of resamples, those of one analysis."""
    if words:
        print(msgspec.json.encode(take(words[0], int(words[1]))).decode())
        return
    show(analysis_figures())


if __name__ == "__main__":
    main(sys.argv[1:])
