"""The bookkeeping between a learner and whoever runs its episodes: pure."""

from collections import deque
from collections.abc import Iterator, Sequence

from eigenfail.contracts import EpisodeEngine, Estimator, Learner, Trained
from eigenfail.errors import LearnerFailed, ProtocolError
from eigenfail.values import (
    EpisodeResult,
    EpisodeTask,
    Estimate,
    Policy,
    PolicySource,
    Proposal,
    Round,
    StopRules,
    episode_seed,
)
from eigenfail_services.campaigns import stopping
from eigenfail_services.campaigns.checkpoint import (
    FORMAT,
    Checkpoint,
    read_checkpoint,
    write_checkpoint,
)
from eigenfail_services.campaigns.stopping import Tally

NO_RULES = StopRules()
OPEN_WAS_FINISHED = " The round that was open was finished."


class Rounds:
    """Asks a learner for rounds within its budget and lookahead, and has it observe them in order.

    A round is observed whole, in index order, exactly once; so the episodes of a campaign are the
    same whoever runs them, and however late or mixed their results come.

    Args:
        learner: fresh, or to be restored with `restore`.
        campaign_seed: from which every episode's seed is derived.
        budget: number of episodes of the campaign.
        rules: what ends it before that; judged after each round, of which none is cut short. With
            such rules no more than one round is open besides the oldest, or they would come late.
    """

    def __init__(
        self, learner: Learner, campaign_seed: int, budget: int, rules: StopRules = NO_RULES
    ) -> None:
        self._learner = learner
        self._campaign_seed = campaign_seed
        self._budget = budget
        self._rules = rules
        self._tally = Tally()
        self._stopped = ""
        self._open: deque[Round] = deque()
        self._number = 0
        self._episodes = 0
        self._ended = False
        self._policy: Policy | None = None

    @property
    def done(self) -> bool:
        """Whether no round is open and none will be proposed."""
        return not self._open and not self._may_propose()

    @property
    def because(self) -> str:
        """Why there is no more to propose, in words; empty while there is."""
        if self._stopped:
            return self._stopped
        if self._episodes >= self._budget:
            return f"The budget of {self._budget} episodes was spent."
        return "The method had no more to propose." if self._ended else ""

    def estimate(self) -> Estimate | None:
        """The failure probability after the last round observed; None if the learner tells none."""
        return self._learner.estimate() if isinstance(self._learner, Estimator) else None

    def trained_episodes(self) -> int | None:
        """How many episodes the learner was trained with; None if it does not say."""
        return self._learner.trained_episodes if isinstance(self._learner, Trained) else None

    def open(self) -> tuple[Round, ...]:
        """The open rounds, oldest first, proposing as far as lookahead and budget allow.

        Empty at the campaign's end.

        Raises:
            LearnerFailed: the learner proposed more than it was asked for.
        """
        while len(self._open) <= self._lookahead() and self._may_propose():
            self._propose()
        return tuple(self._open)

    def complete(self, results: Sequence[EpisodeResult]) -> None:
        """Have the learner observe the oldest open round.

        Args:
            results: all of that round, in any order.

        Raises:
            ProtocolError: these are not the results of that round.
        """
        ordered = sorted(results, key=lambda result: result.index)
        expected = [task.index for task in self._open[0].tasks] if self._open else []
        if not expected or [result.index for result in ordered] != expected:
            raise ProtocolError(
                f"Results {_span([r.index for r in ordered])} are not those of the oldest open "
                f"round {_span(expected)}.",
                "Deliver every round whole, once, oldest first.",
            )
        self._learner.observe(ordered)
        self._open.popleft()
        self._tally = self._tally.after(ordered)
        if self._may_propose():
            self._stopped = self._judge()

    def _judge(self) -> str:
        """What the rules on results say, with the rounds that will be finished all the same."""
        estimate = self.estimate() if self._rules.cv is not None else None
        words = stopping.by_results(self._rules, self._tally, estimate)
        return words and words + (OPEN_WAS_FINISHED if self._open else "")

    def _lookahead(self) -> int:
        wanted = self._learner.lookahead
        return min(wanted, 1) if stopping.depends_on_results(self._rules) else wanted

    def checkpoint(self) -> bytes:
        """Everything needed to go on bit for bit, open rounds and their policies included."""
        checkpoint = Checkpoint(
            format=FORMAT,
            campaign_seed=self._campaign_seed,
            budget=self._budget,
            number=self._number,
            episodes=self._episodes,
            ended=self._ended,
            policy=self._policy,
            rounds=tuple(self._open),
            learner=self._learner.state(),
            tally=self._tally,
            stopped=self._stopped,
        )
        return write_checkpoint(checkpoint)

    def restore(self, data: bytes) -> None:
        """Go on from a checkpoint of the same campaign.

        Raises:
            ProtocolError: the bytes are not a checkpoint of this campaign and method.
        """
        checkpoint = read_checkpoint(data)
        if (checkpoint.campaign_seed, checkpoint.budget) != (self._campaign_seed, self._budget):
            raise ProtocolError(
                f"The checkpoint is of a campaign with seed {checkpoint.campaign_seed} and "
                f"{checkpoint.budget} episodes, not {self._campaign_seed} and {self._budget}."
            )
        self._learner.restore(checkpoint.learner)
        self._open = deque(checkpoint.rounds)
        self._number = checkpoint.number
        self._episodes = checkpoint.episodes
        self._ended = checkpoint.ended
        self._policy = checkpoint.policy
        self._tally = checkpoint.tally
        self._stopped = checkpoint.stopped

    def _may_propose(self) -> bool:
        return not (self._ended or self._stopped) and self._episodes < self._budget

    def _propose(self) -> None:
        left = self._budget - self._episodes
        proposal = self._learner.propose(left)
        if len(proposal.sources) > left:
            raise LearnerFailed(
                f"The learner proposed {len(proposal.sources)} episodes where {left} were left.",
                "Correct the method: propose(n) may return at most n.",
            )
        self._policy = proposal.policy or self._policy
        self._ended = not proposal.sources
        if proposal.sources:
            self._open.append(self._round(proposal))
            self._number += 1
            self._episodes += len(proposal.sources)

    def _round(self, proposal: Proposal) -> Round:
        tasks = tuple(
            EpisodeTask(index, episode_seed(self._campaign_seed, index), source)
            for index, source in enumerate(proposal.sources, self._episodes)
        )
        # Whoever takes over after a crash has seen no earlier round: each brings its policy along.
        needed = any(isinstance(source, PolicySource) for source in proposal.sources)
        return Round(self._number, tasks, self._policy if needed else None)


def run_in_process(rounds: Rounds, engine: EpisodeEngine) -> Iterator[EpisodeResult]:
    """Run a whole campaign in this process; its results in index order."""
    while opened := rounds.open():
        oldest = opened[0]
        if oldest.policy is not None:
            engine.learn(oldest.policy)
        results = []
        for result in engine.run(oldest.tasks):
            results.append(result)
            yield result
        rounds.complete(results)


def _span(indices: Sequence[int]) -> str:
    return f"{indices[0]}…{indices[-1]} ({len(indices)})" if indices else "(none)"
