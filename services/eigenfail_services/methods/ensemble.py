"""An ensemble: several learners of one method with different seeds, in one campaign.

One learner tends to stay in the first failure mode that it finds. Other seeds find other modes.
"""

from collections import deque
from collections.abc import Sequence
from typing import Annotated, Any

import msgspec
import numpy as np
from msgspec import Meta

from eigenfail import plugins
from eigenfail.contracts import Estimator, Exploiter, Learner, MethodTraits, Trained
from eigenfail.errors import InvalidValue, UnknownName
from eigenfail.settings import read_settings
from eigenfail.values.arrays import decode_array, encode_array
from eigenfail.values.episode import MAX_SEED, EpisodeResult, PolicySource
from eigenfail.values.estimates import Estimate
from eigenfail.values.learning import LearnerContext, Policy, Proposal
from eigenfail_services.methods import archive, check_budget
from eigenfail_services.statistics.pooled_estimate import pool_estimates


class EnsembleSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Settings of `ensemble`: each member has the same method and settings, and its own seed."""

    method: Annotated[str, Meta(description="of every member")] = "ast"
    members: Annotated[
        int, Meta(ge=2, le=16, description="learners that share the episodes evenly")
    ] = 4
    settings: Annotated[dict[str, Any], Meta(description="of the members' method")] = {}
    judged: Annotated[
        int,
        Meta(
            ge=0,
            le=1_000_000,
            description="last episodes, in which members are judged, so that `evaluate` uses the "
            "best one; 0: it uses all in turn",
        ),
    ] = 0

    def __post_init__(self) -> None:
        """Check the settings of the members.

        Raises:
            UnknownName: the method or the setting does not exist.
            InvalidValue: a setting is out of bounds, or the members cannot be judged.
        """
        if self.method not in plugins.names(plugins.METHODS):
            raise UnknownName("settings.method", self.method, plugins.names(plugins.METHODS))
        if self.method == "ensemble":
            problem = "an ensemble has no ensembles as members."
            raise InvalidValue("settings.method", problem, "Give it more members.")
        self.read_member_settings()
        if self.judged:
            self._check_judged()

    def _check_judged(self) -> None:
        if not hasattr(plugins.load(plugins.METHODS, self.method), "exploit"):
            raise InvalidValue(
                "settings.judged",
                f"{self.method} learns nothing that could be judged.",
                "Leave it at 0, or take a method that learns, such as ast, cem or difs.",
            )
        if self.judged < self.members:
            raise InvalidValue(
                "settings.judged",
                f"{self.judged} episodes do not judge each of {self.members} members.",
                "Ask for some dozen episodes for each member, or for 0.",
            )

    def check_budget(self, episodes: int) -> None:
        """Raise InvalidValue if a member's share is too small or too large for its method."""
        settings = self.read_member_settings()
        # Shares differ by one episode at most: there are two different ones.
        for share in set(self.divide_training(episodes)):
            check_budget(settings, share)

    def divide_training(self, episodes: int) -> list[int]:
        """Return the number of training episodes of each member.

        Raises:
            InvalidValue: a member would remain without episodes.
        """
        if self.judged >= episodes:
            raise InvalidValue(
                "settings.judged",
                f"judging takes {self.judged} of {episodes} episodes, and leaves none to learn.",
                "Ask for more episodes, or judge in fewer.",
            )
        return divide_episodes(episodes - self.judged, self.members)

    def read_member_settings(self) -> Any:
        """Return the settings of the members' method."""
        kind = plugins.load(plugins.METHODS, self.method).Settings
        return read_settings(kind, self.settings, "settings.settings")


def divide_episodes(episodes: int, members: int) -> list[int]:
    """Divide episodes evenly; the first members get the remainder.

    Raises:
        InvalidValue: there are fewer episodes than members.
    """
    if episodes < members:
        raise InvalidValue(
            "settings.members",
            f"{members} members cannot share {episodes} episodes.",
            "Ask for fewer members, or for more episodes.",
        )
    return [episodes // members + (number < episodes % members) for number in range(members)]


def make_member(
    context: LearnerContext, settings: EnsembleSettings, number: int, share: int
) -> Learner:
    """Return a new learner with its seed and its share of the episodes."""
    method = plugins.load(plugins.METHODS, settings.method)
    seed = make_member_seed(context.seed, number)
    own = msgspec.structs.replace(context, seed=seed, episodes=share)
    learner: Learner = method(own, settings.read_member_settings())
    return learner


def make_member_seed(seed: int, number: int) -> int:
    """Return the seed of a member, from the ensemble's seed and the member's number."""
    # A spawned seed: with seed + number, members of neighbouring campaigns would be the same.
    sequence = np.random.SeedSequence([seed], spawn_key=(1, number))
    return int(sequence.generate_state(1, np.uint64)[0]) & MAX_SEED


_encoder = msgspec.msgpack.Encoder(enc_hook=encode_array)


_policies = msgspec.msgpack.Decoder(tuple[Policy | None, ...], dec_hook=decode_array)


class JudgingRecord(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The results of a member in its judging episodes.

    Attributes:
        episodes: number of judging episodes.
        failures: number of failed episodes.
        log_p: sum of log p(x) over the steps of the failures.
        steps: number of steps of the failures.
    """

    episodes: int = 0
    failures: int = 0
    log_p: float = 0.0
    steps: int = 0

    def with_results(self, results: Sequence[EpisodeResult]) -> "JudgingRecord":
        """Return the record with the results of further episodes."""
        failed = [result for result in results if result.is_failure]
        return JudgingRecord(
            self.episodes + len(results),
            self.failures + len(failed),
            self.log_p + sum(result.noise.log_probability for result in failed),
            self.steps + sum(result.steps for result in failed),
        )

    def rank(self) -> tuple[float, float]:
        """Return the rank, larger for better members: share of failures, then log p per step."""
        if not self.failures:
            return 0.0, 0.0
        return self.failures / self.episodes, self.log_p / self.steps


class Ensemble:
    """Members take turns with rounds; the proposing member observes its round.

    Each member has an even share of the campaign's episodes as its budget. A member that proposes
    nothing is skipped from then on. Members share trajectories, predecessors and experience.

    In the last `judged` episodes, members are judged after their learning has ended. From then on,
    the ensemble uses the member with the most failures in its judging episodes. If members have
    equally many failures, the likelier failures decide. A campaign that was stopped before all
    members were judged uses the members in turn.

    Policies are numbered by round, so that a version is unique among members. Workers keep the
    newest policies, which have the highest numbers.

    Attributes:
        lookahead: smallest lookahead of the members, for all members together. So no member has
            more open rounds than it allows, even if others are skipped.
        exploit: rounds from the best member, or from the members in turn; it exists only if all
            members can exploit.

    Raises:
        InvalidValue: fewer episodes than members.
    """

    Settings = EnsembleSettings
    traits = MethodTraits(has_members=True, chart_mark=7, references={})

    class _Facts(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
        """State: the member in turn, the number of the next round, and the members' states.

        Attributes:
            waiting: members with open rounds, in the order of the rounds.
            left: number of episodes left for each member.
            policies: newest policy of each member.
            unjudged: number of judging episodes left for each member.
            judging: number of open rounds with judging episodes; they are the last entries of
                `waiting`.
            records: judging record of each member.
        """

        turn: Annotated[int, Meta(ge=0)]
        number: Annotated[int, Meta(ge=0)]
        waiting: tuple[int, ...]
        left: tuple[int, ...]
        policies: bytes
        learners: tuple[bytes, ...]
        unjudged: tuple[int, ...]
        judging: Annotated[int, Meta(ge=0)]
        records: tuple[JudgingRecord, ...]

    def __init__(self, context: LearnerContext, settings: EnsembleSettings) -> None:
        count = settings.members
        self._left = settings.divide_training(context.episodes)
        self._unjudged = divide_episodes(settings.judged, count) if settings.judged else [0] * count
        self._judging = 0
        self._records = [JudgingRecord()] * count
        self._members = [make_member(context, settings, i, self._left[i]) for i in range(count)]
        self._policies: tuple[Policy | None, ...] = (None,) * count
        self._waiting: deque[int] = deque()
        self._turn = 0
        self._number = 0
        self._look_ahead()
        self._exploiters = [one for one in self._members if isinstance(one, Exploiter)]
        # An attribute and not a method: `Exploiter` is asked for by the presence of `exploit`.
        if len(self._exploiters) == count:
            self.exploit = self._exploit

    def propose(self, n: int) -> Proposal:
        """Return a round of the next active member; after the learning, judging rounds."""
        # All members learn to their end before the first is judged.
        for propose in (self._propose_from, self._judge):
            for _ in self._members:
                proposal = propose(self._next_turn(), n)
                if proposal.sources:
                    self._look_ahead()
                    return proposal
        return Proposal(())

    def observe(self, results: Sequence[EpisodeResult]) -> None:
        """Pass a round to the member that proposed it, which learns or is judged."""
        # Rounds that judge are opened last, so that they are the last of those that wait.
        is_judged = len(self._waiting) == self._judging
        one = self._waiting.popleft()
        if is_judged:
            self._judging -= 1
            self._records[one] = self._records[one].with_results(results)
        else:
            self._members[one].observe(results)
        self._look_ahead()

    def estimate(self) -> Estimate | None:
        """Return the pooled estimate of the members; None unless each member has an estimate."""
        found = [one.estimate() for one in self._members if isinstance(one, Estimator)]
        estimates = [estimate for estimate in found if estimate is not None]
        return pool_estimates(estimates) if len(estimates) == len(self._members) else None

    @property
    def trained_episodes(self) -> int | None:
        """Number of training episodes of all members; None if a member does not report it."""
        counts = [one.trained_episodes for one in self._members if isinstance(one, Trained)]
        known = [count for count in counts if count is not None]
        return sum(known) if len(known) == len(self._members) else None

    def state(self) -> bytes:
        """Return the states of all members and of the turns."""
        facts = self._Facts(
            turn=self._turn,
            number=self._number,
            waiting=tuple(self._waiting),
            left=tuple(self._left),
            policies=_encoder.encode(self._policies),
            learners=tuple(one.state() for one in self._members),
            unjudged=tuple(self._unjudged),
            judging=self._judging,
            records=tuple(self._records),
        )
        return archive.write("ensemble", facts, {})

    def restore(self, state: bytes) -> None:
        """Restore a state, so that learning continues bit for bit.

        Raises:
            ProtocolError: the bytes do not fit this method and its settings.
        """
        facts, _ = archive.read("ensemble", state, self._Facts)
        count = len(self._members)
        with archive.wrap_errors("ensemble"):
            policies = _policies.decode(facts.policies)
            parts = (policies, facts.left, facts.learners, facts.unjudged, facts.records)
            if {len(part) for part in parts} != {count}:
                raise ValueError(f"they are of {len(facts.learners)} members, not {count}")
        for one, learner in zip(self._members, facts.learners, strict=True):
            one.restore(learner)
        self._turn, self._number = facts.turn, facts.number
        self._waiting = deque(facts.waiting)
        self._left, self._policies = list(facts.left), policies
        self._unjudged, self._judging = list(facts.unjudged), facts.judging
        self._records = list(facts.records)
        self._look_ahead()

    def _look_ahead(self) -> None:
        """Open as many rounds as every active member allows.

        Members are judged after they have observed all their rounds, and then in parallel.
        """
        going = [one for one, left in zip(self._members, self._left, strict=True) if left]
        if going or not any(self._unjudged):
            self.lookahead = min(one.lookahead for one in going or self._members)
        else:
            self.lookahead = len(self._members) if len(self._waiting) == self._judging else 0

    def _judge(self, one: int, n: int) -> Proposal:
        """Return judging episodes of a member; empty if it has been judged."""
        count = min(n, self._unjudged[one])
        if not count:
            return Proposal(())
        self._unjudged[one] -= count
        self._judging += 1
        self._waiting.append(one)
        return self._number_policy(one, self._exploiters[one].exploit(count))

    def _propose_from(self, one: int, n: int) -> Proposal:
        """Return the proposal of a member; if it is empty, the member is skipped from then on."""
        most = min(n, self._left[one])
        proposal = self._members[one].propose(most) if most else Proposal(())
        if not proposal.sources:
            self._left[one] = 0
            return proposal
        self._left[one] -= len(proposal.sources)
        self._waiting.append(one)
        return self._number_policy(one, proposal)

    def _exploit(self, n: int) -> Proposal:
        """Return n episodes of the best member; of the next member if some are still unjudged."""
        if all(record.episodes for record in self._records) and not any(self._unjudged):
            one = max(range(len(self._records)), key=lambda one: self._records[one].rank())
        else:
            one = self._next_turn()
        return self._number_policy(one, self._exploiters[one].exploit(n))

    def _next_turn(self) -> int:
        one = self._turn
        self._turn = (one + 1) % len(self._members)
        return one

    def _number_policy(self, one: int, proposal: Proposal) -> Proposal:
        """Return a member's proposal with a new version for its policy and all its sources."""
        # A member may send no policy with a round, but each round needs a version of its own.
        policy = proposal.policy or self._policies[one]
        self._policies = (*self._policies[:one], policy, *self._policies[one + 1 :])
        number = self._number
        self._number += 1
        sources = tuple(
            PolicySource(number) if isinstance(source, PolicySource) else source
            for source in proposal.sources
        )
        return Proposal(sources, policy and msgspec.structs.replace(policy, version=number))


__all__ = ["Ensemble"]
