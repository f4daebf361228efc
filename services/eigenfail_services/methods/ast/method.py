"""AST as a learner: soft actor-critic on the paper's decision process (Lee et al. 2020)."""

from collections.abc import Sequence
from typing import Annotated

import msgspec
import numpy as np
from msgspec import structs

from eigenfail.contracts import MethodTraits, Reference
from eigenfail.errors import InvalidValue
from eigenfail.values import learning
from eigenfail.values.episode import EpisodeResult, PolicySource
from eigenfail.values.estimates import Estimate
from eigenfail_services.methods import archive
from eigenfail_services.methods.ast import decisions
from eigenfail_services.methods.ast.averaging import PolicyAverage
from eigenfail_services.methods.ast.probability import PolicyProbability, read_open_policies
from eigenfail_services.methods.ast.settings import AstSettings, Trainer, make_trainer
from eigenfail_services.statistics.importance import WeightedFailures

Count = Annotated[int, msgspec.Meta(ge=0)]

WINDOW = 100
"""Number of the last episodes that show whether training has converged, or is stuck."""

STUCK_SHARE = 0.1
"""Share of failures among them below which an attempt is given up."""

WIDENING = 1.5
"""Factor by which the amplitude of the next attempt is larger."""


class Attempt(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A training from new networks, with an empty replay buffer.

    Attributes:
        number: number of earlier attempts.
        first: index of its first episode.
        kept_before: number of episodes that were added to the buffers of earlier attempts.
        widening: amplitude of the attempt ÷ amplitude of the settings.
    """

    number: Count = 0
    first: Count = 0
    kept_before: Count = 0
    widening: float = 1.0

    def derive_seed(self, seed: int) -> int:
        """Return the seed of networks and batches; for the first attempt, the learner's seed."""
        # The first attempt has the learner's own seed: without a restart, nothing differs from a
        # campaign without `patience`.
        if not self.number:
            return seed
        return int(np.random.SeedSequence([seed, self.number]).generate_state(1)[0])


class RestartRule(msgspec.Struct, frozen=True):
    """Rule that gives up an attempt and widens the amplitude of the next attempt.

    An attempt that finds almost nothing has too few failures to learn from: within its amplitude,
    random episodes fail too rarely. So the next attempt has a larger amplitude, up to a bound.

    Attributes:
        patience: number of episodes after which an attempt may be given up, if as many are left;
            None to never give up.
        amplitude: amplitude of the settings. [sigma]
        largest_amplitude: bound of the widened amplitude. [sigma]
        episodes: budget of the campaign.
    """

    patience: int | None
    amplitude: float
    largest_amplitude: float
    episodes: int

    def is_stuck(
        self, attempt: Attempt, observed: int, proposed: int, recent: tuple[bool, ...]
    ) -> bool:
        """Return whether an attempt must be given up.

        Args:
            attempt: present attempt.
            observed: number of observed episodes of the campaign.
            proposed: number of proposed episodes; the next attempt learns from later episodes.
            recent: failure flags of the attempt's last episodes, at most `WINDOW`.
        """
        if self.patience is None or len(recent) < WINDOW:
            return False
        tried, left = observed - attempt.first, self.episodes - proposed
        # With fewer left, another attempt would be given less than the one that is given up.
        is_due = tried >= self.patience <= left
        return is_due and sum(recent) < STUCK_SHARE * WINDOW

    def start_next(self, attempt: Attempt, first: int, kept: int) -> Attempt:
        """Return the attempt that follows an abandoned one.

        Args:
            attempt: abandoned attempt.
            first: index of the new attempt's first episode.
            kept: number of episodes that were added to buffers so far, by all attempts.
        """
        return Attempt(attempt.number + 1, first, kept, self.widen(attempt.widening))

    def widen(self, widening: float) -> float:
        """Return the next larger widening, within `largest_amplitude`."""
        return max(widening, min(widening * WIDENING, self.largest_amplitude / self.amplitude))


def make_reward(settings: AstSettings, context: learning.LearnerContext) -> decisions.Reward:
    """Return the reward from the settings, for the noise of a campaign."""
    paper = decisions.PaperReward(settings.alpha, settings.c_dist)
    if settings.reward == "mahalanobis":
        return decisions.MahalanobisReward(settings.alpha, settings.c_dist)
    if settings.reward == "dissimilarity":
        nothing = np.zeros((0, context.horizon, context.channels), np.float32)
        return decisions.DissimilarityReward(paper, settings.c_dissimilarity, nothing)
    return paper


class AstFacts(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """State of a learner besides its arrays.

    Attributes:
        version: version of the policy, which increases with each training and each change of
            amplitude.
        trainings: number of trainings so far.
        amplitude: amplitude of this version. [sigma]
        proposed: number of proposed episodes.
        observed: number of observed episodes, including errored ones.
        kept: number of episodes that were added to the replay buffer.
        trained: number of kept episodes that the networks were trained on.
        fresh: number of decisions that still lack gradient steps.
        recent: failure flags of the last episodes in the buffer.
        converged: whether training has ended.
        attempt: the present attempt.
        sums: sums of the importance weights of failures.
        under: encoded policies of the open rounds that will be weighted.
    """

    amplitude: float
    version: Count = 0
    trainings: Count = 0
    proposed: Count = 0
    observed: Count = 0
    kept: Count = 0
    trained: Count = 0
    fresh: Count = 0
    recent: tuple[bool, ...] = ()
    converged: bool = False
    attempt: Attempt = Attempt()
    sums: WeightedFailures = WeightedFailures()
    under: bytes = b""

    def with_amplitude(self, amplitude: float) -> "AstFacts":
        """Return the state with an amplitude, as a new version, since workers cache versions."""
        if amplitude == self.amplitude:
            return self
        return msgspec.structs.replace(self, version=self.version + 1, amplitude=amplitude)


FIELD = "settings.warm_start"


def _adopt_networks(trainer: Trainer, context: learning.LearnerContext, campaign: int) -> None:
    """Load the final networks of an earlier campaign into a new trainer.

    Raises:
        InvalidValue: the campaign is not available, or its networks have other shapes.
        ProtocolError: its state is not a state of `ast`.
    """
    _, arrays = archive.read("ast", _find_predecessor(context, campaign).state, AstFacts)
    try:
        trainer.adopt(arrays)
    except ValueError as error:
        raise InvalidValue(
            FIELD,
            f"the networks of campaign {campaign} do not fit: {error}.",
            "Use that campaign's `hidden` and `trainer`.",
        ) from error


def _find_predecessor(context: learning.LearnerContext, campaign: int) -> learning.Predecessor:
    """Return an earlier campaign of `ast` from the context."""
    before = context.predecessor(campaign)
    if before is not None and before.method == "ast":
        return before
    raise InvalidValue(
        FIELD,
        f"the learner of campaign {campaign} is not at hand, or is none of ast.",
        "Name a campaign of ast that has ended.",
    )


class AdaptiveStressTesting:
    """Learns a policy that disturbs the planner's perception until the ego crashes.

    Warm-up episodes come from the untrained policy: their noise is nearly uniform within the
    amplitude and held for `hold` steps. Draws from the prior would be useless, as any tracker
    filters white noise.

    If `converged_share` is set, training ends when this share of the last 100 episodes failed, and
    the campaign continues with the present policy. If almost none failed after `patience` episodes,
    training restarts with new networks and a larger amplitude, up to `largest_amplitude`.

    Raises:
        InvalidValue: the campaign of `warm_start` is not available or does not fit.

    Attributes:
        lookahead: 1, as the next policy is trained while the previous round still runs. With
            `parallel`, as many rounds as it needs: policies then learn from older rounds.
    """

    Settings = AstSettings

    traits = MethodTraits(
        tolerates_delay=True, chart_mark=1, references={"warm_start": Reference.OWN_LEARNER}
    )
    lookahead = 1

    def __init__(self, context: learning.LearnerContext, settings: AstSettings) -> None:
        settings.check_entropy(context.channels)
        self._settings = settings
        self._reward = make_reward(settings, context)
        self._seed = context.seed
        self._channels = context.channels
        self.lookahead = learning.count_rounds_ahead(
            context.parallel, settings.round_size, self.lookahead
        )
        self._trainer = self._make_trainer(Attempt())
        self._average = PolicyAverage(settings.averaged)
        self._warm_up = min(settings.warm_up, context.episodes // 4)
        self._facts = AstFacts(amplitude=settings.amplitude)
        self._restarts = RestartRule(
            settings.patience, settings.amplitude, settings.largest_amplitude, context.episodes
        )
        self._horizon = context.horizon
        self._probability = PolicyProbability(settings.hold, context.episodes, context.channels)
        if settings.warm_start is not None:
            _adopt_networks(self._trainer, context, settings.warm_start)

    @property
    def trained_episodes(self) -> int:
        """Number of episodes that the policy was trained on; constant after convergence."""
        return self._facts.trained

    def propose(self, n: int) -> learning.Proposal:
        """Return a round with the newest policy."""
        count, facts = min(n, self._settings.round_size), self._facts
        # Before the policy is made: workers keep a version as they first got it.
        facts = facts.with_amplitude(self._get_amplitude())
        self._facts = structs.replace(facts, proposed=facts.proposed + count)
        policy = self._make_policy(facts)
        # Noted now: by the time of its results, the policy has been trained further.
        self._probability.begin(facts.proposed, policy)
        return _propose_policy(policy, count)

    def exploit(self, n: int) -> learning.Proposal:
        """Return n episodes with the mean of the last policies, at the last amplitude."""
        return _propose_policy(self._make_final_policy(), n)

    def weigh(self, sums: WeightedFailures, results: Sequence[EpisodeResult]) -> WeightedFailures:
        """Return the sums with the episodes of `exploit` added; unchanged if hold > 1."""
        return self._probability.weigh(sums, results, self._make_final_policy())

    def estimate_from_sums(self, sums: WeightedFailures, horizon: int) -> Estimate | None:
        """Return a lower bound of the failure probability; None without episodes."""
        return self._probability.estimate_from_sums(sums, horizon, self._get_amplitude())

    def estimate(self) -> Estimate | None:
        """Return the estimate over the second half of the budget; None if hold > 1."""
        reach = self._get_amplitude()
        return self._probability.estimate(self._facts.observed, self._horizon, reach)

    def observe(self, results: Sequence[EpisodeResult]) -> None:
        """Learn from completed episodes, until training has converged.

        Raises:
            LearnerDiverged: training diverged.
            LearnerFailed: an episode holds NaN.
        """
        first = self._facts.observed
        self._facts = structs.replace(self._facts, observed=first + len(results))
        self._probability.end(first, results)
        # A round that was proposed before a restart has the old amplitude, and is not learnt from.
        if not self._facts.converged and first >= self._facts.attempt.first:
            self._add_to_buffer([result for result in results if decisions.is_usable(result)])
            # Before training: the policy that has converged is kept, without another step.
            self._facts = structs.replace(self._facts, converged=self._has_converged())
            self._train()
            self._restart_if_stuck()

    def state(self) -> bytes:
        """Return networks, optimizers, replay buffer, data of the reward, counters and sums."""
        arrays = {
            **self._trainer.arrays(),
            **self._reward.arrays(),
            **self._average.arrays(),
        }
        weighed = self._probability
        facts = structs.replace(self._facts, sums=weighed.sums, under=weighed.encode_open())
        return archive.write("ast", facts, arrays)

    def restore(self, state: bytes) -> None:
        """Restore a state, so that learning continues bit for bit.

        Raises:
            ProtocolError: the bytes do not fit this method and its settings.
        """
        facts, arrays = archive.read("ast", state, AstFacts)
        with archive.wrap_errors("ast"):
            policies = read_open_policies(facts.under)
            reward = self._reward.load(arrays)
            trainer = self._make_trainer(facts.attempt)
            trainer.load(arrays)
            average = PolicyAverage(self._settings.averaged)
            average.load(arrays, trainer.policy(facts.version))
        self._probability.load(facts.sums, policies)
        self._trainer, self._average, self._reward, self._facts = trainer, average, reward, facts

    def _make_trainer(self, attempt: Attempt) -> Trainer:
        return make_trainer(self._settings, self._channels, attempt.derive_seed(self._seed))

    def _get_amplitude(self) -> float:
        """Return the amplitude of the present attempt. [sigma]"""
        return self._settings.amplitude * self._facts.attempt.widening

    def _make_final_policy(self) -> learning.Policy:
        facts = self._facts.with_amplitude(self._get_amplitude())
        return self._average.apply(self._make_policy(facts))

    def _make_policy(self, facts: AstFacts) -> learning.Policy:
        """Return the present actor with the version and amplitude of a state."""
        actor = self._trainer.policy(facts.version)
        return structs.replace(actor, amplitude=facts.amplitude)

    def _add_to_buffer(self, results: Sequence[EpisodeResult]) -> None:
        """Add a round to the replay buffer."""
        facts, fresh = self._facts, self._facts.fresh
        process, amplitude = self._settings.process(), self._get_amplitude()
        for result in results:
            found = decisions.make_decisions(result, self._reward, process, amplitude)
            self._trainer.add(found)
            fresh += len(found.rewards)
        self._reward = self._reward.update(results)
        failed = [result.is_failure for result in results]
        self._facts = structs.replace(
            facts,
            kept=facts.kept + len(failed),
            recent=(*facts.recent, *failed)[-WINDOW:],
            fresh=fresh,
        )

    def _has_converged(self) -> bool:
        """Return whether enough of the last episodes failed."""
        share, facts = self._settings.converged_share, self._facts
        if share is None or len(facts.recent) < WINDOW:
            return False
        return sum(facts.recent) >= share * WINDOW

    def _train(self) -> None:
        """Take the gradient steps for the fresh decisions."""
        facts = self._facts
        kept = facts.kept - facts.attempt.kept_before
        # Counted from the attempt: a restart begins with an empty buffer and warms up again.
        if facts.fresh and not facts.converged and kept >= self._warm_up:
            trainings = facts.trainings + 1
            self._trainer.train(facts.fresh * self._settings.gradient_steps, draw=trainings)
            self._facts = structs.replace(
                facts,
                version=facts.version + 1,
                trainings=trainings,
                trained=facts.kept,
                fresh=0,
            )
            self._average.add(self._make_policy(self._facts))

    def _restart_if_stuck(self) -> None:
        """Start the next attempt if the present attempt finds almost nothing."""
        facts, rule = self._facts, self._restarts
        is_stuck = rule.is_stuck(facts.attempt, facts.observed, facts.proposed, facts.recent)
        if is_stuck and not facts.converged:
            attempt = rule.start_next(facts.attempt, facts.proposed, facts.kept)
            # A new version: workers know the last one as the policy of the old networks.
            self._facts = structs.replace(
                facts, version=facts.version + 1, fresh=0, recent=(), attempt=attempt
            )
            self._trainer = self._make_trainer(attempt)
            self._average = PolicyAverage(self._settings.averaged)


def _propose_policy(policy: learning.Policy, count: int) -> learning.Proposal:
    """Return a proposal of `count` episodes with one policy."""
    return learning.Proposal((PolicySource(policy.version),) * count, policy)
