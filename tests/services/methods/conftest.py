from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from eigenfail.settings import read_settings
from eigenfail.testing.toy import Corridor, ToyEngine
from eigenfail.values import (
    EpisodeResult,
    LearnerContext,
    Measures,
    NoiseTrajectory,
    Outcome,
    learner_seed,
)
from eigenfail_services.campaigns.rounds import Rounds, run_in_process

Campaign = Callable[..., list[EpisodeResult]]


@pytest.fixture
def campaign() -> Campaign:
    """Run a whole campaign of a method in a corridor, in this process."""

    def run(
        method: Any, corridor: Corridor, episodes: int, seed: int = 0, **settings: Any
    ) -> list[EpisodeResult]:
        nothing = np.zeros((0, corridor.steps, 2), np.float32)
        context = LearnerContext(learner_seed(seed), episodes, corridor.steps, nothing)
        learner = method(context, read_settings(method.Settings, settings, "settings"))
        return list(run_in_process(Rounds(learner, seed, episodes), ToyEngine(corridor)))

    return run


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


@pytest.fixture
def prior_failure_rate() -> Callable[[Corridor], float]:
    """Failure rate of a corridor under the prior, by brute force."""

    def rate(corridor: Corridor, batches: int = 20, size: int = 10_000) -> float:
        random = np.random.default_rng(12345)
        failed = sum(
            int((corridor.course(z) >= corridor.wall).any(axis=1).sum())
            for z in (random.standard_normal((size, corridor.steps, 2)) for _ in range(batches))
        )
        return failed / (batches * size)

    return rate
