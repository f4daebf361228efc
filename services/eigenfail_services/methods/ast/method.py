"""AST as a learner: soft actor-critic on the paper's decision process (Lee et al. 2020)."""

from collections.abc import Sequence

from msgspec import structs

from eigenfail.values import EpisodeResult, Estimate, LearnerContext, Policy, PolicySource, Proposal
from eigenfail_services.methods import archive
from eigenfail_services.methods.ast.amplitudes import Amplitudes
from eigenfail_services.methods.ast.decisions import decisions, usable
from eigenfail_services.methods.ast.facts import WINDOW, Facts
from eigenfail_services.methods.ast.probability import PolicyProbability, read_open
from eigenfail_services.methods.ast.rewards import make_reward
from eigenfail_services.methods.ast.settings import AstSettings
from eigenfail_services.methods.ast.trainer import make_trainer
from eigenfail_services.methods.ast.warm_start import begin_from
from eigenfail_services.statistics.importance import WeightedFailures


class AdaptiveStressTesting:
    """Learns a policy that disturbs what the planner perceives until it crashes.

    Warm-up episodes come from the untrained policy: near-uniform within the amplitude and held for
    `hold` steps. Draws from the prior would teach nothing: any tracker filters white noise away.

    Once `converged_share` of the last 100 episodes failed, training ends: the campaign goes on
    under the policy as it stands.

    Raises:
        InvalidValue: the campaign to start from is not at hand or does not fit.

    Attributes:
        lookahead: the next policy is trained while the previous round still runs.
    """

    Settings = AstSettings

    lookahead = 1

    def __init__(self, context: LearnerContext, settings: AstSettings) -> None:
        self._settings = settings
        self._reward = make_reward(settings, context.horizon)
        self._trainer = make_trainer(settings.trainer, settings.options(context.seed))
        self._warm_up = min(settings.warm_up, context.episodes // 4)
        first = settings.first_amplitude or settings.amplitude
        self._amplitudes = Amplitudes(first, settings.amplitude, context.episodes)
        self._facts = Facts(amplitude=first)
        self._horizon = context.horizon
        self._probability = PolicyProbability(settings.hold, settings.amplitude, context.episodes)
        if settings.warm_start is not None:
            begin_from(self._trainer, context, settings.warm_start)

    @property
    def trained_episodes(self) -> int:
        """How many episodes the policy was trained with; it stands still after convergence."""
        return self._facts.trained

    def propose(self, n: int) -> Proposal:
        """A round under the newest policy."""
        count, facts = min(n, self._settings.round_size), self._facts
        facts = facts.reaching(self._amplitudes.at(facts.proposed))
        self._facts = structs.replace(facts, proposed=facts.proposed + count)
        policy = self._policy(facts)
        self._probability.begin(facts.proposed, policy)
        return under(policy, count)

    def exploit(self, n: int) -> Proposal:
        """Exactly n episodes under the newest policy, at its last amplitude; nothing is learnt."""
        return under(self._exploiting(), n)

    def weigh(self, sums: WeightedFailures, results: Sequence[EpisodeResult]) -> WeightedFailures:
        """With episodes that `exploit` proposed; the sums as they are where hold > 1."""
        return self._probability.weigh(sums, results, self._exploiting())

    def tell(self, sums: WeightedFailures, horizon: int) -> Estimate | None:
        """A lower bound of the failure probability by importance sampling; None over no episode."""
        return self._probability.tell(sums, horizon)

    def estimate(self) -> Estimate | None:
        """The same over the second half of the budget; None where hold > 1."""
        return self._probability.estimate(self._facts.observed, self._horizon)

    def observe(self, results: Sequence[EpisodeResult]) -> None:
        """Learn from the episodes that were run to their end, until training has converged.

        Raises:
            LearnerDiverged: training diverged.
            LearnerFailed: an episode holds NaN.
        """
        first = self._facts.observed
        self._facts = structs.replace(self._facts, observed=first + len(results))
        self._probability.end(first, results)
        if not self._facts.converged:
            self._keep([result for result in results if usable(result)], first)
            self._facts = structs.replace(self._facts, converged=self._has_converged())
            self._train()

    def state(self) -> bytes:
        """Networks, targets, optimizers, replay buffer, what the reward knows, counters, sums."""
        arrays = {**self._trainer.arrays(), **self._reward.arrays()}
        weighed = self._probability
        facts = structs.replace(self._facts, sums=weighed.sums, under=weighed.open())
        return archive.write("ast", facts, arrays)

    def restore(self, state: bytes) -> None:
        """Go on from there, bit for bit.

        Raises:
            ProtocolError: the bytes are not a state of this method with these settings.
        """
        facts, arrays = archive.read("ast", state, Facts)
        with archive.refusing("ast"):
            policies = read_open(facts.under)
            reward = self._reward.loaded(arrays)
            self._trainer.load(arrays)
        self._probability.load(facts.sums, policies)
        self._reward, self._facts = reward, facts

    def _exploiting(self) -> Policy:
        return self._policy(self._facts.reaching(self._amplitudes.last))

    def _policy(self, facts: Facts) -> Policy:
        """The actor as it stands, with the version and reach of these facts."""
        actor = self._trainer.policy(facts.version)
        return structs.replace(actor, amplitude=facts.amplitude)

    def _keep(self, results: Sequence[EpisodeResult], first: int) -> None:
        """Put a round into the replay buffer; `first` is its first episode's number."""
        facts, fresh = self._facts, self._facts.fresh
        process, amplitude = self._settings.process(), self._amplitudes.at(first)
        for result in results:
            found = decisions(result, self._reward, process, amplitude)
            self._trainer.add(found)
            fresh += len(found.rewards)
        self._reward = self._reward.after(results)
        told = [result.is_failure for result in results]
        self._facts = structs.replace(facts.after(told), fresh=fresh)

    def _has_converged(self) -> bool:
        """Whether enough of the last episodes failed, all under the last amplitude."""
        share, facts = self._settings.converged_share, self._facts
        settled = self._amplitudes.settled(facts.observed - WINDOW)
        return share is not None and settled and facts.fails_in(share)

    def _train(self) -> None:
        """Take the gradient steps that are due."""
        facts = self._facts
        if facts.fresh and not facts.converged and facts.kept >= self._warm_up:
            trainings = facts.trainings + 1
            self._trainer.train(facts.fresh * self._settings.gradient_steps, draw=trainings)
            self._facts = structs.replace(
                facts,
                version=facts.version + 1,
                trainings=trainings,
                trained=facts.kept,
                fresh=0,
            )


def under(policy: Policy, count: int) -> Proposal:
    """Episodes of a policy."""
    return Proposal((PolicySource(policy.version),) * count, policy)
