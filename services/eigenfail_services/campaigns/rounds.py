"""The bookkeeping between a learner and whoever runs its episodes: pure."""

from collections import deque
from collections.abc import Iterator, Sequence

import msgspec

from eigenfail.contracts import EpisodeEngine, Learner
from eigenfail.errors import LearnerFailed, ProtocolError
from eigenfail.values import (
    EpisodeResult,
    EpisodeTask,
    Policy,
    PolicySource,
    Proposal,
    Round,
    episode_seed,
)
from eigenfail.values.arrays import decode_array, encode_array

FORMAT = 1


class Checkpoint(msgspec.Struct, frozen=True, eq=False, forbid_unknown_fields=True):
    """The learner's state and the rounds that were open when it was taken.

    Attributes:
        format: counts up when older programs could not read it.
        episodes: how many have been proposed.
        policy: the newest policy version.
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


_encoder = msgspec.msgpack.Encoder(enc_hook=encode_array)
_decoder = msgspec.msgpack.Decoder(Checkpoint, dec_hook=decode_array)


class Rounds:
    """Asks a learner for rounds within its budget and lookahead, and has it observe them in order.

    A round is observed whole, in index order, exactly once; so the episodes of a campaign are the
    same whoever runs them, and however late or mixed their results come.

    Args:
        learner: fresh, or to be restored with `restore`.
        campaign_seed: from which every episode's seed is derived.
        budget: number of episodes of the campaign.
    """

    def __init__(self, learner: Learner, campaign_seed: int, budget: int) -> None:
        self._learner = learner
        self._campaign_seed = campaign_seed
        self._budget = budget
        self._open: deque[Round] = deque()
        self._number = 0
        self._episodes = 0
        self._ended = False
        self._policy: Policy | None = None

    @property
    def done(self) -> bool:
        """Whether no round is open and none will be proposed."""
        return not self._open and (self._ended or self._episodes >= self._budget)

    def open(self) -> tuple[Round, ...]:
        """The open rounds, oldest first, proposing as far as lookahead and budget allow.

        Empty at the campaign's end.

        Raises:
            LearnerFailed: the learner proposed more than it was asked for.
        """
        while len(self._open) <= self._learner.lookahead and self._may_propose():
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
        )
        return _encoder.encode(checkpoint)

    def restore(self, data: bytes) -> None:
        """Go on from a checkpoint of the same campaign.

        Raises:
            ProtocolError: the bytes are not a checkpoint of this campaign and method.
        """
        checkpoint = _read(data)
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

    def _may_propose(self) -> bool:
        return not self._ended and self._episodes < self._budget

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


def _read(data: bytes) -> Checkpoint:
    try:
        checkpoint = _decoder.decode(data)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise ProtocolError(
            f"The campaign's checkpoint cannot be read: {error}.", "Start the campaign anew."
        ) from error
    if checkpoint.format != FORMAT:
        raise ProtocolError(
            f"The checkpoint has format {checkpoint.format}, this program reads {FORMAT}.",
            "Finish the campaign with the version of eigenfail that began it.",
        )
    return checkpoint


def _span(indices: Sequence[int]) -> str:
    return f"{indices[0]}…{indices[-1]} ({len(indices)})" if indices else "(none)"
