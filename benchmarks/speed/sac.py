"""Gradient steps per second: the numpy trainer of `ast` against stable-baselines3's.

`python -m benchmarks.speed.sac` prints the ratios of every batch size of the paper's sweep.
"""

import json
import os
import subprocess
import sys
import time
from statistics import median
from typing import Any

import msgspec
import numpy as np
from benchmarks.figures import ROOT, Figure

from eigenfail.processes import NUMERIC_ENVIRONMENT

COMMAND = "make bench"
BATCH_SIZES = (16, 64, 256)
CHOSEN = 16
"""The batch size of the paper's main runs."""

THREADS = (1, 2)
STEPS, PAIRS, KEPT = 100, 3, 2000


def measure() -> dict[int, list[float]]:
    """The ratios of each batch size, pair by pair, in this process."""
    return {size: [ratio(size) for _ in range(PAIRS)] for size in BATCH_SIZES}


def ratio(batch_size: int) -> float:
    """Steps per second on one thread ÷ those of stable-baselines3 on as many as suit it."""
    import torch

    fast, reference = (trainer(name, batch_size) for name in ("fast", "sb3"))
    rates = []
    for threads in THREADS:
        torch.set_num_threads(threads)
        rates.append(rate(reference))
    return rate(fast) / max(rates)


def trainer(name: str, batch_size: int) -> Any:
    """A trainer with the paper's settings and a memory to draw from."""
    from eigenfail.values.disturbance import AXES
    from eigenfail.values.learning import STATE
    from eigenfail_services.methods.ast.decisions import Decisions
    from eigenfail_services.methods.ast.settings import AstSettings, make_trainer

    papers = AstSettings(alpha=5000.0, c_dist=1000.0, tau=0.001, learning_rate=3e-4)
    settings = msgspec.structs.replace(papers, batch_size=batch_size, trainer=name)
    made = make_trainer(settings, len(AXES), seed=1)
    random = np.random.default_rng(1)
    states = random.standard_normal((KEPT + 1, len(STATE)), np.float32)
    made.add(
        Decisions(
            states=states[:-1],
            actions=random.uniform(-1.0, 1.0, (KEPT, len(AXES))).astype(np.float32),
            rewards=random.standard_normal(KEPT, np.float32),
            next_states=states[1:],
            ends=(random.uniform(size=KEPT) < 0.1).astype(np.float32),
        )
    )
    made.train(STEPS // 5, draw=0)
    return made


def rate(made: Any) -> float:
    """Gradient steps per second."""
    before = time.perf_counter()
    made.train(STEPS, draw=1)
    return STEPS / (time.perf_counter() - before)


def sac_figures() -> dict[str, Figure]:
    """The middle of the pairs at the paper's batch size, with those of the others in words."""
    command = [sys.executable, "-m", "benchmarks.speed.sac"]
    environment = os.environ | NUMERIC_ENVIRONMENT
    done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, check=True)
    found = {int(size): ratios for size, ratios in json.loads(done.stdout).items()}
    told = ", ".join(f"{median(ratios):.3g} at {size}" for size, ratios in found.items())
    ratios = found[CHOSEN]
    figure = Figure(
        value=median(ratios),
        unit="ratio",
        n=len(ratios),
        spread=(min(ratios), max(ratios)),
        target=">= 3",
        note=f"by batch size: {told}",
        command=COMMAND,
    )
    return {"sac_over_sb3": figure}


if __name__ == "__main__":
    print(json.dumps(measure()))
