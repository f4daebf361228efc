"""Every random draw comes from the campaign's seed."""

import numpy as np

MAX_SEED = 2**63 - 1


def episode_seed(campaign_seed: int, index: int) -> int:
    """The seed of episode `index`: a function of the campaign's seed and the index alone."""
    state = np.random.SeedSequence([campaign_seed, index]).generate_state(1, np.uint64)
    return int(state[0]) & MAX_SEED


def learner_seed(campaign_seed: int) -> int:
    """The seed of the learner's own draws, apart from those of all episodes."""
    state = np.random.SeedSequence([campaign_seed], spawn_key=(0,)).generate_state(1, np.uint64)
    return int(state[0]) & MAX_SEED
