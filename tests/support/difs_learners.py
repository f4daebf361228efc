"""Learners of DiFS that train for a moment, on the processor."""

from typing import Any

import numpy as np

from eigenfail.settings import read_settings
from eigenfail.values.learning import Experience, LearnerContext, Proposal
from eigenfail_services.methods.difs.method import DiffusionFailureSampling

STEPS = 5


def make_difs(
    episodes: int = 100, horizon: int = STEPS, experience: Experience | None = None, **settings: Any
) -> DiffusionFailureSampling:
    """A learner for noise of two channels."""
    nothing = np.zeros((0, horizon, 2), np.float32)
    quick = {"first_steps": 20, "steps": 10, "width": 24, "device": "cpu"}
    return DiffusionFailureSampling(
        LearnerContext(0, episodes, horizon, nothing, experience=experience),
        read_settings(DiffusionFailureSampling.Settings, quick | settings, "settings"),
    )


def noise_of(proposal: Proposal) -> np.ndarray:
    """The noise of the samples of a proposal, shape (episodes, steps, channels)."""
    return np.stack([source.z for source in proposal.sources if hasattr(source, "z")])
