"""The learners of an ensemble, before they have learnt anything."""

import msgspec
import numpy as np

from eigenfail import plugins
from eigenfail.contracts import Learner
from eigenfail.values import LearnerContext
from eigenfail.values.randomness import MAX_SEED
from eigenfail_services.methods.ensemble.settings import EnsembleSettings


def member(context: LearnerContext, settings: EnsembleSettings, number: int, share: int) -> Learner:
    """A new learner with its own seed and its share of the episodes."""
    method = plugins.load(plugins.METHODS, settings.method)
    seed = member_seed(context.seed, number)
    own = msgspec.structs.replace(context, seed=seed, episodes=share)
    learner: Learner = method(own, settings.of_members())
    return learner


def member_seed(seed: int, number: int) -> int:
    """The seed of a member: a function of the ensemble's and of the member's number alone."""
    sequence = np.random.SeedSequence([seed], spawn_key=(1, number))
    return int(sequence.generate_state(1, np.uint64)[0]) & MAX_SEED
