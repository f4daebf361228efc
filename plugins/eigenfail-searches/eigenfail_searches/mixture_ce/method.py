"""The cross-entropy method with a mixture of normals of unit variance."""

from collections.abc import Sequence
from math import exp
from typing import Annotated

import msgspec
import numpy as np

from eigenfail.contracts import MethodTraits
from eigenfail.values.episode import EpisodeResult, PriorSource, TrajectorySource
from eigenfail.values.learning import LearnerContext, Proposal, RoundSizes
from eigenfail_searches.mixture_ce import modes
from eigenfail_searches.mixture_ce.elite import has_elites, select_elite
from eigenfail_searches.mixture_ce.settings import MixtureCeSettings
from eigenfail_services.methods import archive
from eigenfail_services.methods.archive import take
from eigenfail_services.methods.batch_learner import limit_round
from eigenfail_services.methods.trials import TrialMemory

SCALE_GAIN = 0.3
SMALLEST_SCALE, LARGEST_SCALE = 0.3, 1.2

MOST_COMPONENTS = 4
"""Largest number of components until the elites of all of them are failures.

Later the number does not grow: the failures of one mode would be split.
"""

EXPLOITS = 2**32
"""First draw of `exploit`, so that exploitation does not change the draws of learning."""


class MixtureCrossEntropy:
    """Samples noise around the means of the least robust episodes, in rounds.

    The cross-entropy method (Rubinstein and Kroese 2004), whose density is a mixture of normals of
    unit variance. Its means and shares are fitted, and their number is chosen by held-out
    likelihood.

    Attributes:
        lookahead: 0, as each round is sampled from a mixture of all earlier rounds.
    """

    Settings = MixtureCeSettings

    class _Facts(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
        """State besides arrays: counters, and the factor of the means."""

        scale: float
        proposed: Annotated[int, msgspec.Meta(ge=0)] = 0
        draws: Annotated[int, msgspec.Meta(ge=0)] = 0
        exploits: Annotated[int, msgspec.Meta(ge=0)] = 0

    traits = MethodTraits(chart_mark=18, references={})
    lookahead = 0

    def __init__(self, context: LearnerContext, settings: MixtureCeSettings) -> None:
        self._settings = settings
        self._seed = context.seed
        self._shape = context.horizon, context.channels
        self._initial = settings.size_initial(context.episodes)
        self._round_size = limit_round(context, settings.size_round(context.episodes))
        self._jitter = settings.choose_jitter(context.horizon)
        self._mixture = modes.make_prior_mixture(context.horizon * context.channels)
        self._trials = TrialMemory(*self._shape, settings.memory)
        self._facts = self._Facts(settings.scale)

    @staticmethod
    def round_sizes(settings: MixtureCeSettings, episodes: int) -> RoundSizes:
        """Return the number of draws from the prior, and the size of each later round."""
        return RoundSizes(settings.size_initial(episodes), settings.size_round(episodes))

    def propose(self, n: int) -> Proposal:
        """Return draws from the prior, later samples of the mixture."""
        proposed = self._facts.proposed
        if proposed < self._initial:
            proposal = Proposal((PriorSource(),) * min(n, self._initial - proposed))
        else:
            self._update_facts(draws=self._facts.draws + 1)
            proposal = self._sample(min(n, self._round_size), self._facts.draws, self._mixture)
        self._update_facts(proposed=proposed + len(proposal.sources))
        return proposal

    def observe(self, results: Sequence[EpisodeResult]) -> None:
        """Keep the trajectories, adapt the factor of the means, and fit the mixture."""
        fresh = TrialMemory(*self._shape, len(results))
        fresh.add(results)
        if not len(fresh):
            return
        self._trials.add(results)
        # Before the first sample all episodes come from the prior, which says nothing of the scale.
        if self._facts.draws:
            self._adapt_scale(float(np.mean(fresh.robustness <= 0.0)))
        self._fit()

    def exploit(self, n: int) -> Proposal:
        """Return samples of the components with failures, if there are any, without learning."""
        self._update_facts(exploits=self._facts.exploits + 1)
        failed = self._assign_components()[self._trials.robustness <= 0.0]
        mixture = self._mixture.restrict(np.unique(failed))
        return self._sample(n, EXPLOITS + self._facts.exploits, mixture)

    def state(self) -> bytes:
        """Return mixture, trajectories and counters."""
        mixture = {"shares": self._mixture.shares, "means": self._mixture.means}
        return archive.write("mixture_ce", self._facts, {**mixture, **self._trials.arrays()})

    def restore(self, state: bytes) -> None:
        """Restore a state, from which learning goes on bit for bit.

        Raises:
            ProtocolError: the bytes are not a state of this method with these settings.
        """
        facts, arrays = archive.read("mixture_ce", state, self._Facts)
        with archive.wrap_errors("mixture_ce"):
            shape = len(arrays["shares"]), self._mixture.means.shape[1]
            self._mixture = modes.Mixture(arrays["shares"], take(arrays, "means", shape))
            self._trials.load(arrays)
        self._facts = facts

    def _fit(self) -> None:
        trials, settings, components = self._trials, self._settings, self._assign_components()
        rows = select_elite(trials, settings.elite, settings.likely_share, components)
        elite = modes.prepare_elite(trials.z[rows], trials.find_unseen()[rows], self._jitter)
        settled = has_elites(trials, settings.elite, components)
        most = len(self._mixture.shares) if settled else MOST_COMPONENTS
        self._mixture = modes.fit_mixture(elite, most)

    def _adapt_scale(self, rate: float) -> None:
        """Lower the factor of the means if more samples fail than the target rate, else raise it.

        So samples are as likely as the target rate allows. It begins when all elites are failures.
        """
        if has_elites(self._trials, self._settings.elite, self._assign_components()):
            moved = self._facts.scale * exp(SCALE_GAIN * (self._settings.target_rate - rate))
            most = max(LARGEST_SCALE, self._settings.scale)
            self._update_facts(scale=min(max(moved, SMALLEST_SCALE), most))

    def _sample(self, count: int, draw: int, mixture: modes.Mixture) -> Proposal:
        random = np.random.default_rng([self._seed, draw])
        means = mixture.means[mixture.draw_components(count, random)]
        z = random.standard_normal((count, *self._shape)) + self._facts.scale * means.reshape(
            count, *self._shape
        )
        return Proposal(tuple(TrajectorySource(each.astype(np.float32)) for each in z))

    def _assign_components(self) -> modes.Rows:
        """Return the likeliest component of each trajectory, shape (n,)."""
        return self._mixture.assign(self._trials.z, self._trials.find_unseen())

    def _update_facts(self, **changes: float) -> None:
        self._facts = msgspec.structs.replace(self._facts, **changes)
