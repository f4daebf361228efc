"""Evaluate: what an earlier campaign has learnt is used, in any scenario, and learns no further."""

from collections.abc import Callable, Sequence
from typing import Annotated

import msgspec
import numpy as np

from eigenfail import plugins
from eigenfail.contracts import Exploiter, Learner
from eigenfail.errors import InvalidValue
from eigenfail.settings import read_settings
from eigenfail.values import (
    EpisodeResult,
    Estimate,
    LearnerContext,
    Predecessor,
    Proposal,
    TrajectorySource,
)
from eigenfail_services.methods import archive
from eigenfail_services.methods.weighing import Weigher
from eigenfail_services.statistics.importance import WeightedFailures


class Evaluate:
    """Proposes what the learner of an earlier campaign knows best, until the budget is spent.

    All draws are this campaign's own: the earlier learner is made anew with this campaign's seed,
    and restored from its last state. So two evaluations of one campaign differ by their seeds
    alone, and with one seed are the same in two scenarios as far as the scenarios are.

    Args:
        context: its one predecessor is what is evaluated.
        settings: say which campaign that is.

    Raises:
        InvalidValue: there is no predecessor, or it has learnt nothing that could be used.
        ProtocolError: its state is not one of its method.

    Attributes:
        lookahead: enough that no worker ever waits for the end of a round.
    """

    class Settings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
        """Settings of `evaluate`."""

        campaign: Annotated[
            int, msgspec.Meta(ge=1, description="the campaign whose knowledge is evaluated")
        ]
        round_size: Annotated[
            int, msgspec.Meta(ge=1, le=100_000, description="episodes in a round")
        ] = 20

    class _Facts(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
        """How many episodes have been proposed, what the earlier learner is by now, and sums."""

        proposed: Annotated[int, msgspec.Meta(ge=0)]
        learner: bytes
        sums: WeightedFailures = WeightedFailures()

    lookahead = 3

    def __init__(self, context: LearnerContext, settings: Settings) -> None:
        self._campaign = settings.campaign
        self._round_size = settings.round_size
        self._horizon = context.horizon
        self._learner = reborn(context, settings.campaign)
        self._exploit = exploitation(self._learner, settings.campaign)
        self._proposed = 0
        self._sums = WeightedFailures()

    def propose(self, n: int) -> Proposal:
        """A round of the best that is known.

        Raises:
            InvalidValue: it is noise trajectories for episodes of another length.
        """
        proposal = self._exploit(min(n, self._round_size))
        for source in proposal.sources:
            if isinstance(source, TrajectorySource) and len(source.z) != self._horizon:
                raise other_horizon(self._campaign, len(source.z), self._horizon)
        self._proposed += len(proposal.sources)
        return proposal

    def observe(self, results: Sequence[EpisodeResult]) -> None:
        """Weigh them where that can be done; nothing is learnt from them."""
        if isinstance(self._learner, Weigher):
            self._sums = self._learner.weigh(self._sums, results)

    def estimate(self) -> Estimate | None:
        """The failure probability from all episodes so far; None where their density is unknown."""
        weigher = self._learner
        return weigher.tell(self._sums, self._horizon) if isinstance(weigher, Weigher) else None

    def state(self) -> bytes:
        """How far it has come, the earlier learner with it, and the sums of the weights."""
        facts = self._Facts(self._proposed, self._learner.state(), self._sums)
        return archive.write("evaluate", facts, {})

    def restore(self, state: bytes) -> None:
        """Go on from there, bit for bit.

        Raises:
            ProtocolError: the bytes are not a state of this method with this predecessor.
        """
        facts, _ = archive.read("evaluate", state, self._Facts)
        self._learner.restore(facts.learner)
        self._proposed, self._sums = facts.proposed, facts.sums


def reborn(context: LearnerContext, campaign: int) -> Learner:
    """The learner of an earlier campaign as it was in the end, its draws those of this seed.

    Raises:
        InvalidValue: the context does not hold it.
        ProtocolError: its state is not one of its method.
    """
    before = predecessor(context, campaign)
    method = plugins.load(plugins.METHODS, before.method)
    own = LearnerContext(
        seed=context.seed,
        episodes=before.episodes,
        horizon=before.horizon,
        trajectories=np.zeros((0, before.horizon, 2), np.float32),
    )
    given = read_settings(method.Settings, before.settings, f"settings of campaign {campaign}")
    learner: Learner = method(own, given)
    learner.restore(before.state)
    return learner


def predecessor(context: LearnerContext, campaign: int) -> Predecessor:
    """What the context holds of an earlier campaign.

    Raises:
        InvalidValue: nothing.
    """
    if (before := context.predecessor(campaign)) is not None:
        return before
    raise InvalidValue(
        "settings.campaign",
        f"the learner of campaign {campaign} is not at hand.",
        "Give it to the context as a predecessor; the service does so by itself.",
    )


def exploitation(learner: Learner, campaign: int) -> Callable[[int], Proposal]:
    """The learner's `exploit`.

    Raises:
        InvalidValue: it has none.
    """
    if isinstance(learner, Exploiter):
        return learner.exploit
    raise InvalidValue(
        "settings.campaign",
        f"the method of campaign {campaign} learns nothing that could be used.",
        "Name a campaign of a method that learns, such as ast, difs or cem.",
    )


def other_horizon(campaign: int, steps: int, horizon: int) -> InvalidValue:
    """Noise trajectories do not fit the episodes."""
    return InvalidValue(
        "settings.campaign",
        f"campaign {campaign} learnt noise of {steps} steps, but an episode has {horizon} here.",
        "Evaluate it in a scenario of as many steps, or evaluate a policy (ast), which fits any.",
    )
