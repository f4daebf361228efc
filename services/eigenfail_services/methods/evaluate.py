"""Evaluate: use the learner of an earlier campaign in any scenario, without more learning."""

from collections.abc import Callable, Sequence
from typing import Annotated, Protocol, runtime_checkable

import msgspec
import numpy as np
from msgspec import Meta

from eigenfail import contracts, plugins
from eigenfail.errors import InvalidValue
from eigenfail.settings import read_settings
from eigenfail.values.episode import EpisodeResult, TrajectorySource
from eigenfail.values.estimates import Estimate
from eigenfail.values.learning import LearnerContext, Predecessor, Proposal, count_rounds_ahead
from eigenfail_services.methods import RoundSize, archive
from eigenfail_services.statistics.importance import WeightedFailures


@runtime_checkable
class Weigher(Protocol):
    """An exploiter whose draws have a known density q, so that P(failure) can be estimated."""

    def weigh(self, sums: WeightedFailures, results: Sequence[EpisodeResult]) -> WeightedFailures:
        """Return the sums with episodes of `exploit` added, weighted by its present density."""

    def estimate_from_sums(self, sums: WeightedFailures, horizon: int) -> Estimate | None:
        """Return the estimate from given sums; None if it does not exist.

        Args:
            sums: sums of all weighted episodes.
            horizon: the number of steps of a full episode.
        """


class EvaluateSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Settings of `evaluate`."""

    campaign: Annotated[int, Meta(ge=1, description="the campaign whose knowledge is evaluated")]
    round_size: RoundSize = 20


class Evaluate:
    """Proposes exploiting episodes of an earlier campaign's learner, within the budget.

    The earlier learner is created with this campaign's seed and restored from its last state. So
    two evaluations of one campaign differ only by their seeds. With the same seed, their noise in
    two scenarios differs only as far as the scenarios differ.

    Args:
        context: context with the predecessor to evaluate.
        settings: settings with the predecessor's campaign.

    Raises:
        InvalidValue: the predecessor is missing, or its learner cannot exploit.
        ProtocolError: the predecessor's state does not fit its method.

    Attributes:
        lookahead: 3, or what `parallel` takes: no worker waits for the end of a round.
    """

    Settings = EvaluateSettings

    class _Facts(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
        """State: the number of proposed episodes, the earlier learner's state, and sums."""

        proposed: Annotated[int, Meta(ge=0)]
        learner: bytes
        sums: WeightedFailures

    traits = contracts.MethodTraits(
        tolerates_delay=True,
        independent=True,
        learns=False,
        finds_new=False,
        mode_probability=contracts.ModeProbability.KNOWN_PROPOSAL,
        chart_mark=5,
        references={"campaign": contracts.Reference.LEARNER},
    )
    lookahead = 3

    def __init__(self, context: LearnerContext, settings: EvaluateSettings) -> None:
        self._campaign = settings.campaign
        self._round_size = settings.round_size
        self.lookahead = count_rounds_ahead(context.parallel, self._round_size, self.lookahead)
        self._horizon = context.horizon
        self._learner = restore_learner(context, settings.campaign)
        self._exploit = _get_exploit(self._learner, settings.campaign)
        self._proposed = 0
        self._sums = WeightedFailures()

    def propose(self, n: int) -> Proposal:
        """Return a round of exploiting episodes.

        Raises:
            InvalidValue: the learner's noise trajectories differ in length from the episodes.
        """
        proposal = self._exploit(min(n, self._round_size))
        for source in proposal.sources:
            # A trajectory of another length would be cut, or filled with zeros that nobody has
            # learnt.
            if isinstance(source, TrajectorySource) and len(source.z) != self._horizon:
                raise InvalidValue(
                    "settings.campaign",
                    f"campaign {self._campaign} learnt noise of {len(source.z)} steps, but an "
                    f"episode has {self._horizon} here.",
                    "Evaluate it in a scenario of as many steps, or evaluate a policy (ast), which "
                    "fits any.",
                )
        self._proposed += len(proposal.sources)
        return proposal

    def observe(self, results: Sequence[EpisodeResult]) -> None:
        """Add the weights of episodes if their density is known; do not learn."""
        if isinstance(self._learner, Weigher):
            self._sums = self._learner.weigh(self._sums, results)

    def estimate(self) -> Estimate | None:
        """Return the failure probability from all episodes; None for an unknown density."""
        weigher = self._learner
        return (
            weigher.estimate_from_sums(self._sums, self._horizon)
            if isinstance(weigher, Weigher)
            else None
        )

    def state(self) -> bytes:
        """Return number of episodes, state of the earlier learner, and sums of the weights."""
        facts = self._Facts(self._proposed, self._learner.state(), self._sums)
        return archive.write("evaluate", facts, {})

    def restore(self, state: bytes) -> None:
        """Restore a state, so that learning continues bit for bit.

        Raises:
            ProtocolError: the bytes do not fit this method and this predecessor.
        """
        facts, _ = archive.read("evaluate", state, self._Facts)
        # The earlier learner counts its draws: without that a resumed campaign would repeat noise.
        self._learner.restore(facts.learner)
        self._proposed, self._sums = facts.proposed, facts.sums


def restore_learner(context: LearnerContext, campaign: int) -> contracts.Learner:
    """Return the learner of an earlier campaign in its last state, with this campaign's seed.

    Raises:
        InvalidValue: the context does not hold the campaign.
        ProtocolError: the campaign's state does not fit its method.
    """
    before = _find_predecessor(context, campaign)
    method = plugins.load(plugins.METHODS, before.method)
    # Budget and horizon are those of training: the state fits no others.
    own = LearnerContext(
        seed=context.seed,
        episodes=before.episodes,
        horizon=before.horizon,
        trajectories=np.zeros((0, before.horizon, context.channels), np.float32),
    )
    given = read_settings(method.Settings, before.settings, f"settings of campaign {campaign}")
    learner: contracts.Learner = method(own, given)
    learner.restore(before.state)
    return learner


def _find_predecessor(context: LearnerContext, campaign: int) -> Predecessor:
    """Return an earlier campaign from the context."""
    if (before := context.predecessor(campaign)) is not None:
        return before
    raise InvalidValue(
        "settings.campaign",
        f"the learner of campaign {campaign} is not at hand.",
        "Give it to the context as a predecessor; the service does so by itself.",
    )


def _get_exploit(learner: contracts.Learner, campaign: int) -> Callable[[int], Proposal]:
    """Return the learner's `exploit`."""
    if isinstance(learner, contracts.Exploiter):
        return learner.exploit
    raise InvalidValue(
        "settings.campaign",
        f"the method of campaign {campaign} learns nothing that could be used.",
        "Name a campaign of a method that learns, such as ast, difs or cem.",
    )
