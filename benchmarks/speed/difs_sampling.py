"""Sampling with the default sampler of DiFS against the full 1000 steps of DDPM."""

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
HORIZON, SAMPLES, PAIRS = 100, 50, 5
TARGET = ">= 30"


def measure() -> list[float]:
    """Time of the full sampler ÷ time of the default one, pair by pair, in this process."""
    from eigenfail_services.methods.difs.model import ConditionalDiffusion
    from eigenfail_services.methods.difs.settings import DifsSettings

    settings = DifsSettings(device="cpu")
    full = msgspec.structs.replace(settings, sampling_steps=1000)
    models = [ConditionalDiffusion(given, HORIZON, 2, 0) for given in (settings, full)]
    for model in models:
        duration(model, draw=0)
    return [
        duration(models[1], pair) / median(duration(models[0], pair) for _ in range(3))
        for pair in range(PAIRS)
    ]


def duration(model: Any, draw: int) -> float:
    """Seconds that a round of samples takes."""
    condition = np.zeros(SAMPLES, np.float32)
    before = time.perf_counter()
    model.sample(condition, 0.0, draw)
    return time.perf_counter() - before


def difs_sampling_figures() -> dict[str, Figure]:
    """The middle of the pairs, measured in a process of its own."""
    command = [sys.executable, "-m", "benchmarks.speed.difs_sampling"]
    environment = os.environ | NUMERIC_ENVIRONMENT
    done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, check=True)
    ratios: list[float] = json.loads(done.stdout)
    figure = Figure(
        value=median(ratios),
        unit="ratio",
        n=len(ratios),
        spread=(min(ratios), max(ratios)),
        target=TARGET,
        command=COMMAND,
    )
    return {"difs_sampling_over_ddpm1000": figure}


if __name__ == "__main__":
    print(json.dumps(measure()))
