"""Members take turns in one campaign."""

from collections import deque
from collections.abc import Sequence
from typing import Annotated

import msgspec

from eigenfail.contracts import Estimator, Exploiter, Trained
from eigenfail.values import (
    EpisodeResult,
    Estimate,
    LearnerContext,
    Policy,
    PolicySource,
    Proposal,
)
from eigenfail.values.arrays import decode_array, encode_array
from eigenfail_services.methods import archive
from eigenfail_services.methods.ensemble.members import member
from eigenfail_services.methods.ensemble.settings import EnsembleSettings, shares
from eigenfail_services.statistics.pooled_estimate import pooled

_encoder = msgspec.msgpack.Encoder(enc_hook=encode_array)
_policies = msgspec.msgpack.Decoder(tuple[Policy | None, ...], dec_hook=decode_array)


class Ensemble:
    """Members take turns: one round from each that has episodes left, which that one observes.

    Each has an even share of the campaign's episodes as its budget; one that proposes nothing more
    is passed over from then on. Members share trajectories, predecessors and experience.

    Policies are numbered by round, so that a version is unique over members and the newest has
    the highest number, which is what workers keep.

    Attributes:
        lookahead: that of the members, over all of them together: then none ever has more rounds
            open than it bears, whoever is passed over, and each proposes from fresher knowledge
            than it would alone.
        exploit: rounds from one member after the other; only where members can.

    Raises:
        InvalidValue: fewer episodes than members.
    """

    Settings = EnsembleSettings

    class _Facts(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
        """Whose turn it is, the number of the next round, and for each member what is its own.

        Attributes:
            waiting: members whose rounds are open, the oldest round's first.
            left: episodes that each may still propose.
            policies: the newest of each.
        """

        turn: Annotated[int, msgspec.Meta(ge=0)]
        number: Annotated[int, msgspec.Meta(ge=0)]
        waiting: tuple[int, ...]
        left: tuple[int, ...]
        policies: bytes
        learners: tuple[bytes, ...]

    def __init__(self, context: LearnerContext, settings: EnsembleSettings) -> None:
        count = settings.members
        self._left = shares(context.episodes, count)
        self._members = [member(context, settings, i, self._left[i]) for i in range(count)]
        self._policies: tuple[Policy | None, ...] = (None,) * count
        self._waiting: deque[int] = deque()
        self._turn = 0
        self._number = 0
        self.lookahead = min(one.lookahead for one in self._members)
        self._exploiters = [one for one in self._members if isinstance(one, Exploiter)]
        if len(self._exploiters) == count:
            self.exploit = self._exploited

    def propose(self, n: int) -> Proposal:
        """A round of the next member in turn that has one."""
        for _ in self._members:
            one = self._next_turn()
            proposal = self._asked(one, min(n, self._left[one]))
            if proposal.sources:
                return proposal
        return Proposal(())

    def observe(self, results: Sequence[EpisodeResult]) -> None:
        """The member that proposed the round learns from it."""
        self._members[self._waiting.popleft()].observe(results)

    def estimate(self) -> Estimate | None:
        """The members' estimates pooled; None before each has one, or where none ever has."""
        found = [one.estimate() for one in self._members if isinstance(one, Estimator)]
        told = [estimate for estimate in found if estimate is not None]
        return pooled(told) if len(told) == len(self._members) else None

    @property
    def trained_episodes(self) -> int | None:
        """How many all members together were trained with; None where they do not say."""
        told = [one.trained_episodes for one in self._members if isinstance(one, Trained)]
        known = [count for count in told if count is not None]
        return sum(known) if len(known) == len(self._members) else None

    def state(self) -> bytes:
        """All members, and where the turns stand."""
        facts = self._Facts(
            turn=self._turn,
            number=self._number,
            waiting=tuple(self._waiting),
            left=tuple(self._left),
            policies=_encoder.encode(self._policies),
            learners=tuple(one.state() for one in self._members),
        )
        return archive.write("ensemble", facts, {})

    def restore(self, state: bytes) -> None:
        """Go on from there, bit for bit.

        Raises:
            ProtocolError: the bytes are not a state of this method with these settings.
        """
        facts, _ = archive.read("ensemble", state, self._Facts)
        count = len(self._members)
        with archive.refusing("ensemble"):
            policies = _policies.decode(facts.policies)
            if {len(policies), len(facts.left), len(facts.learners)} != {count}:
                raise ValueError(f"they are of {len(facts.learners)} members, not {count}")
        for one, learner in zip(self._members, facts.learners, strict=True):
            one.restore(learner)
        self._turn, self._number = facts.turn, facts.number
        self._waiting = deque(facts.waiting)
        self._left, self._policies = list(facts.left), policies

    def _asked(self, one: int, most: int) -> Proposal:
        """What a member proposes; if nothing, it is not asked again."""
        proposal = self._members[one].propose(most) if most else Proposal(())
        if not proposal.sources:
            self._left[one] = 0
            return proposal
        self._left[one] -= len(proposal.sources)
        self._waiting.append(one)
        return self._numbered(one, proposal)

    def _exploited(self, n: int) -> Proposal:
        """Exactly n episodes of one member, the next in turn."""
        one = self._next_turn()
        return self._numbered(one, self._exploiters[one].exploit(n))

    def _next_turn(self) -> int:
        one = self._turn
        self._turn = (one + 1) % len(self._members)
        return one

    def _numbered(self, one: int, proposal: Proposal) -> Proposal:
        """A member's proposal with its policy, numbered by round."""
        policy = proposal.policy or self._policies[one]
        self._policies = (*self._policies[:one], policy, *self._policies[one + 1 :])
        number = self._number
        self._number += 1
        sources = tuple(
            PolicySource(number) if isinstance(source, PolicySource) else source
            for source in proposal.sources
        )
        return Proposal(sources, policy and msgspec.structs.replace(policy, version=number))
