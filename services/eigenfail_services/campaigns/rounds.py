"""The rounds of a campaign: proposed by its learner, judged by stop rules, kept in checkpoints.

Nothing here opens a socket or a file.
"""

from collections import deque
from collections.abc import Iterator, Sequence

import msgspec

from eigenfail.contracts import EpisodeEngine, Estimator, Learner, Trained
from eigenfail.errors import LearnerFailed, ProtocolError
from eigenfail.values import episode
from eigenfail.values.arrays import decode_array, encode_array
from eigenfail.values.campaign import BUDGET_SPENT
from eigenfail.values.campaign_spec import StopRules
from eigenfail.values.estimates import Estimate
from eigenfail.values.learning import Policy, Proposal, Round
from eigenfail.values.records import assess
from eigenfail_services.analysis.sampling_design import MOST_AHEAD, OPEN_WAS_FINISHED
from eigenfail_services.statistics.intervals import bound_sequence


class Tally(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Counts of the episodes in the rounds observed so far.

    Attributes:
        unresolved: number of safe episodes that are unresolved, or may be.
    """

    completed: int = 0
    failures: int = 0
    errored: int = 0
    unresolved: int = 0

    def after(self, results: Sequence[episode.EpisodeResult]) -> "Tally":
        """Return the counts with another round."""
        completed = sum(result.outcome is not episode.Outcome.ERRORED for result in results)
        failures = sum(result.is_failure for result in results)
        ends = [assess(result.outcome, result.measures).unresolved for result in results]
        return Tally(
            self.completed + completed,
            self.failures + failures,
            self.errored + len(results) - completed,
            self.unresolved + sum(each is not False for each in ends),
        )

    def half_width(self) -> float | None:
        """Return half the width of the failure rate's confidence sequence; None before any episode.

        The interval is checked after every round: an interval for a fixed number of episodes would
        not hold at the check that ends the campaign. The upper end counts errored and unresolved
        episodes as failures, and the lower end does not. The same interval is shown to users.
        """
        if not self.completed:
            return None
        doubtful = self.errored + self.unresolved
        interval = bound_sequence(self.failures, self.completed + self.errored, doubtful)
        return (interval.high - interval.low) / 2.0


def limit_lookahead(lookahead: int, rules: StopRules) -> int:
    """Return how many rounds may be open besides the oldest one.

    With rules on results, at most `MOST_AHEAD`; otherwise the rules would take effect late.
    """
    return min(lookahead, MOST_AHEAD) if rules.judges_results else lookahead


def judge_results(rules: StopRules, tally: Tally, estimate: Estimate | None) -> str:
    """Return which rule on results ends a campaign, in words; empty if none does."""
    width, cv = tally.half_width(), estimate.cv if estimate else None
    known = f"The failure rate is known to ± {_format_figure(width)}"
    bounded = estimate is not None and estimate.bound is not None
    what = "lower bound of the failure probability" if bounded else "failure probability"
    sure = f"The {what} has a coefficient of variation of {_format_figure(cv)}"
    count = tally.failures
    failed = "1 failure was found" if count == 1 else f"{count} failures were found"
    return (
        _reached("failures", rules.failures, count, failed)
        or _fell_to("half_width", rules.half_width, width, known)
        or _fell_to("cv", rules.cv, cv, sure)
    )


def judge_time(rules: StopRules, active_s: float, cost_usd: float) -> str:
    """Return which rule on time or cost ends a campaign, in words; empty if none does."""
    lasted, cost = (
        f"It ran for {_format_figure(active_s)} s",
        f"It cost {_format_figure(cost_usd)} USD",
    )
    return _reached("wall_s", rules.wall_s, active_s, lasted) or _reached(
        "cost_usd", rules.cost_usd, cost_usd, cost
    )


def _format_figure(figure: float | None) -> str:
    return "nothing" if figure is None else f"{figure:.4g}"


def _reached(name: str, limit: float | None, figure: float, words: str) -> str:
    holds = limit is not None and figure >= limit
    return f"{words} (rule: {name} = {limit})." if holds else ""


def _fell_to(name: str, limit: float | None, figure: float | None, words: str) -> str:
    holds = limit is not None and figure is not None and figure <= limit
    return f"{words} (rule: {name} = {limit})." if holds else ""


FORMAT = 3
"""Format 1 had neither tally nor stop rules; it is read as one of a campaign without rules. The
tally of format 2 had no errored or unresolved episodes."""


# A field that is unknown is one of a newer program, which must not be dropped in silence.
class Checkpoint(msgspec.Struct, frozen=True, eq=False, forbid_unknown_fields=True):
    """The learner's state and the rounds that were open when it was taken.

    Attributes:
        format: version of the format, raised when older programs cannot read it.
        episodes: how many have been proposed.
        policy: the newest policy version.
        tally: tally of the rounds observed.
        stopped_because: which stop rule held, in words; empty if none did.
    """

    format: int
    campaign_seed: int
    budget: int
    number: int
    episodes: int
    ended: bool
    policy: Policy | None
    rounds: tuple[Round, ...]
    learner: bytes
    tally: Tally = Tally()
    stopped_because: str = msgspec.field(default="", name="stopped")


_encoder = msgspec.msgpack.Encoder(enc_hook=encode_array)
_decoder = msgspec.msgpack.Decoder(Checkpoint, dec_hook=decode_array)


def write_checkpoint(checkpoint: Checkpoint) -> bytes:
    """Encode a checkpoint as MessagePack, with arrays in their binary form."""
    return _encoder.encode(checkpoint)


def read_checkpoint(data: bytes) -> Checkpoint:
    """Decode a checkpoint of `Rounds.checkpoint`.

    Raises:
        ProtocolError: the bytes are not a checkpoint, or a newer program wrote them.
    """
    try:
        checkpoint = _decoder.decode(data)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise ProtocolError(
            f"The campaign's checkpoint cannot be read: {error}.", "Launch the campaign again."
        ) from error
    if not 1 <= checkpoint.format <= FORMAT:
        raise ProtocolError(
            f"The checkpoint has format {checkpoint.format}, this program reads {FORMAT}.",
            "Finish the campaign with the version of eigenfail that began it.",
        )
    return checkpoint


NO_RULES = StopRules()


class Rounds:
    """Has a learner propose rounds within its budget and lookahead, and observe them in order.

    A round is observed whole, in index order, exactly once; so the episodes of a campaign are the
    same whichever workers run them, and however late or mixed their results come.

    Args:
        learner: fresh, or to be restored with `restore`.
        campaign_seed: seed of the campaign; every episode's seed is derived from it.
        budget: number of episodes of the campaign.
        rules: rules that end it earlier; judged after each round, and rounds are never cut short.
            With rules on results, at most `MOST_AHEAD` rounds are open besides the oldest, or the
            rules would take effect late.
    """

    def __init__(
        self, learner: Learner, campaign_seed: int, budget: int, rules: StopRules = NO_RULES
    ) -> None:
        self._learner = learner
        self._campaign_seed = campaign_seed
        self._budget = budget
        self._rules = rules
        self._tally = Tally()
        self._rule_held = ""
        self._open: deque[Round] = deque()
        self._number = 0
        self._episodes = 0
        self._ended = False
        self._policy: Policy | None = None

    @property
    def stopped_because(self) -> str:
        """Return why no further round is proposed, in words; empty while there is one."""
        if self._rule_held:
            return self._rule_held
        if self._episodes >= self._budget:
            return BUDGET_SPENT.format(self._budget)
        return "The method had no more to propose." if self._ended else ""

    def estimate(self) -> Estimate | None:
        """Return the failure probability after the last round; None without an estimate."""
        return self._learner.estimate() if isinstance(self._learner, Estimator) else None

    def trained_episodes(self) -> int | None:
        """Return the number of episodes that the learner was trained with; None if unknown."""
        return self._learner.trained_episodes if isinstance(self._learner, Trained) else None

    def open(self) -> tuple[Round, ...]:
        """Return the open rounds, oldest first; propose as far as lookahead and budget allow.

        Empty at the campaign's end.

        Raises:
            LearnerFailed: the learner proposed more than it was asked for.
        """
        # A learner may change its look-ahead from round to round.
        while (
            len(self._open) <= limit_lookahead(self._learner.lookahead, self._rules)
            and self._may_propose()
        ):
            self._propose()
        return tuple(self._open)

    def complete(self, results: Sequence[episode.EpisodeResult]) -> None:
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
                f"Results {_format_indices([each.index for each in ordered])} are not those of the "
                f"oldest open round {_format_indices(expected)}.",
                "Deliver every round whole, once, oldest first.",
            )
        self._learner.observe(ordered)
        self._open.popleft()
        self._tally = self._tally.after(ordered)
        # A campaign that has spent its budget has not ended because of a rule.
        if self._may_propose():
            self._rule_held = self._judge()

    def _judge(self) -> str:
        """Return which rule holds, with the remark that open rounds are still finished."""
        estimate = self.estimate() if self._rules.cv is not None else None
        words = judge_results(self._rules, self._tally, estimate)
        return f"{words} {OPEN_WAS_FINISHED}" if words and self._open else words

    def checkpoint(self) -> bytes:
        """Return the state that continues learning bit for bit, including the open rounds."""
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
            stopped_because=self._rule_held,
        )
        return write_checkpoint(checkpoint)

    def restore(self, data: bytes) -> None:
        """Go on from a checkpoint of the same campaign.

        Raises:
            ProtocolError: the bytes are not a checkpoint of this campaign and method.
        """
        checkpoint = read_checkpoint(data)
        # Seeds of episodes follow from the seed of the campaign: with another one the open rounds
        # would be other episodes.
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
        self._rule_held = checkpoint.stopped_because

    def _may_propose(self) -> bool:
        return not (self._ended or self._rule_held) and self._episodes < self._budget

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
            episode.EpisodeTask(index, self._choose_seed(index, source), source)
            for index, source in enumerate(proposal.sources, self._episodes)
        )
        # A worker that takes over after a crash has seen no earlier round: each carries its policy.
        needed = any(isinstance(source, episode.PolicySource) for source in proposal.sources)
        return Round(self._number, tasks, self._policy if needed else None)

    def _choose_seed(self, index: int, source: episode.Source) -> int:
        given = source.seed if isinstance(source, episode.TrajectorySource) else None
        return episode.episode_seed(self._campaign_seed, index) if given is None else given


def run_in_process(rounds: Rounds, engine: EpisodeEngine) -> Iterator[episode.EpisodeResult]:
    """Run a whole campaign in this process, and yield its results in index order.

    The service runs the rounds through the hub; this is for examples, benchmarks and tests.
    """
    while opened := rounds.open():
        oldest = opened[0]
        if oldest.policy is not None:
            engine.add_policy(oldest.policy)
        results = []
        for result in engine.run(oldest.tasks):
            results.append(result)
            yield result
        rounds.complete(results)


def _format_indices(indices: Sequence[int]) -> str:
    return f"{indices[0]}…{indices[-1]} ({len(indices)})" if indices else "(none)"
