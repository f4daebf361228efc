from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from eigenfail.values.disturbance import NoiseTrajectory
from eigenfail.values.episode import EpisodeFault, EpisodeResult, Outcome, unrunnable
from eigenfail.values.measures import Measures


@pytest.fixture
def episode() -> Callable[..., EpisodeResult]:
    """An episode with noise z, sigma (2, 0.5) and states that count its steps."""

    def make(z: Any, robustness_m: float = 0.0, **changes: Any) -> EpisodeResult:
        z = np.asarray(z, np.float32).reshape(-1, 2)
        steps = len(z)
        sigma = np.tile(np.float32([2.0, 0.5]), (steps, 1))
        given = {
            "index": 0,
            "seed": 0,
            "outcome": Outcome.SAFE if robustness_m else Outcome.COLLISION,
            "steps": steps,
            "noise": NoiseTrajectory(z, sigma),
            "source": "policy",
            "measures": Measures(robustness_m),
            "states": np.arange(steps, dtype=np.float32)[:, None] * np.ones(6, np.float32),
        }
        return EpisodeResult(**{**given, **changes})

    return make


class NoiseEngine:
    """Episodes whose robustness is a function of z, shape (n, steps, 2): n values.

    Args:
        robustness: of a batch; a failure at or below 0.
        unrunnable: which z of a batch cannot be run; none by default.
    """

    def __init__(self, robustness: Any, broken: Any = None) -> None:
        self._robustness = robustness
        self._broken = broken or (lambda z: np.zeros(len(z), bool))

    def run(self, tasks: Any) -> Any:
        z = np.stack([task.source.z for task in tasks]).astype(np.float64)
        for task, value, broken in zip(tasks, self._robustness(z), self._broken(z), strict=True):
            if broken:
                yield unrunnable(task, EpisodeFault("simulator", "told to"))
                continue
            yield EpisodeResult(
                index=task.index,
                seed=task.seed,
                outcome=Outcome.SAFE if value > 0.0 else Outcome.COLLISION,
                steps=len(task.source.z),
                noise=NoiseTrajectory(task.source.z, np.ones_like(task.source.z)),
                source=task.source_kind,
                measures=Measures(max(float(value), 0.0)),
            )


@pytest.fixture
def noise_engine() -> type[NoiseEngine]:
    """An engine for a function of noise."""
    return NoiseEngine
