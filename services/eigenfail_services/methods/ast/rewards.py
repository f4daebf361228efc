"""The rewards that can be asked for, by name."""

from collections.abc import Callable

import numpy as np

from eigenfail_services.methods.ast.reward import (
    DissimilarityReward,
    MahalanobisReward,
    PaperReward,
    Reward,
)
from eigenfail_services.methods.ast.settings import AstSettings


def paper(settings: AstSettings, _horizon: int) -> Reward:
    """Log p at every step."""
    return PaperReward(settings.alpha, settings.c_dist)


def mahalanobis(settings: AstSettings, _horizon: int) -> Reward:
    """A distance in place of log p."""
    return MahalanobisReward(settings.alpha, settings.c_dist)


def dissimilarity(settings: AstSettings, horizon: int) -> Reward:
    """The paper's, and a bonus for failures unlike those known."""
    nothing = np.zeros((0, horizon, 2), np.float32)
    return DissimilarityReward(
        PaperReward(settings.alpha, settings.c_dist), settings.c_dissimilarity, nothing
    )


REWARDS: dict[str, Callable[[AstSettings, int], Reward]] = {
    "paper": paper,
    "mahalanobis": mahalanobis,
    "dissimilarity": dissimilarity,
}


def make_reward(settings: AstSettings, horizon: int) -> Reward:
    """The reward that the settings name, for episodes of at most `horizon` steps."""
    return REWARDS[settings.reward](settings, horizon)
