"""One running campaign in the hub: its learner process, its rounds in flight, its leases."""

from collections import Counter
from collections.abc import Callable
from math import inf
from typing import Any

import msgspec

from eigenfail.contracts import Store
from eigenfail.values import EpisodeResult, EpisodeSetup, LearnerContext, Policy, StopRules
from eigenfail.values.records import Verdict
from eigenfail.wire.messages import Message, Observed, Proposed, Start, Trouble
from eigenfail_services.hub.flight import Flight
from eigenfail_services.hub.learner_link import LearnerLink
from eigenfail_services.hub.leases import Leases
from eigenfail_services.hub.meter import Meter, Phase

MAX_REFUSALS = 3
MAX_LEARNER_DEATHS = 3
"""In a row, without a round learnt in between."""


class Order(msgspec.Struct, frozen=True, eq=False):
    """What the hub needs to know to run a campaign, and where it writes down its time."""

    campaign: int
    setup: EpisodeSetup
    method: str
    settings: dict[str, Any]
    seed: int
    context: LearnerContext
    rules: StopRules = StopRules()
    meter: Meter = msgspec.field(default_factory=Meter)


class Run:
    """Moves rounds from the learner to the leases, and whole rounds of results back.

    Attributes:
        ended: why it is over, once it is: an empty text when the learner has no more to propose,
            else the trouble.
        because: why the learner has no more to propose.
    """

    def __init__(self, order: Order, store: Store, leases: Leases) -> None:
        self.order = order
        self.ended: str | None = None
        self.because = ""
        self._store = store
        self._leases = leases
        self._deaths = 0
        self._handlers: dict[type, Callable[[Any], None]] = {
            Proposed: self._proposed,
            Trouble: self._trouble,
        }
        self._landings: dict[Verdict, Callable[[EpisodeResult], None]] = {
            Verdict.KEPT: self._count,
            Verdict.DUPLICATE: self._count,
            Verdict.ALARM: self._dispute,
            Verdict.UNWANTED: self._offer_again,
        }
        self._start()

    @property
    def socket(self) -> Any:
        """What to poll for the learner's words."""
        return self._link.socket

    def _start(self) -> None:
        """A new life of the learner, from its checkpoint; everything open is leased afresh."""
        self._flight = Flight()
        self._learning = True
        self._handed_back = False
        self._unhandled: Message | None = None
        self._disputed: set[int] = set()
        self._refused = Counter[int]()
        self._briefed = False
        self._link = LearnerLink()
        self.look()

    def _brief(self) -> None:
        """Tell a new learner what it is to be; without the store nobody can know."""
        order = self.order
        checkpoint = self._store.checkpoints.load(order.campaign)
        self._link.say(
            Start(order.method, order.settings, order.context, order.seed, checkpoint, order.rules)
        )
        self._briefed = True

    def tend(self) -> None:
        """Hear the learner, and bring it back if it died.

        Raises:
            StoreUnavailable: what it said could not be kept; it is handled at the next call.
        """
        if not self._briefed:
            self._brief()
        self._settle_disputes()
        status = self._link.exit_status()  # before listening: its last words are heard all the same
        while (message := self._unhandled or self._link.hear()) is not None:
            self._unhandled = message
            self._handlers[type(message)](message)
            self._unhandled = None
        if self.ended is None and status is not None:
            self._bury_learner(status)

    def _proposed(self, message: Proposed) -> None:
        campaign = self.order.campaign
        told = message.estimate, message.trained_episodes
        self._store.checkpoints.save(campaign, message.checkpoint, *told)
        self._learning = False
        if self._handed_back:
            self._deaths = 0
        if not message.rounds:
            self.ended, self.because = "", message.because
            return
        indices = [task.index for task in self._flight.new(message.rounds)]
        finished = self._store.episodes.finished(campaign, indices)
        # Only now, when the store can no longer be away: a round takes off once.
        tasks = self._flight.take_off(message.rounds)
        known = {result.index for result in finished}
        self._leases.offer(campaign, tuple(task for task in tasks if task.index not in known))
        for result in finished:
            self._flight.land(result)
        self._hand_back()

    def _trouble(self, message: Trouble) -> None:
        self.ended = message.problem

    def _bury_learner(self, status: int) -> None:
        self._deaths += 1
        self.stop()
        if self._deaths >= MAX_LEARNER_DEATHS:
            self.ended = (
                f"The learner process died {self._deaths} times in a row, at last with exit "
                f"status {status}. Its log says why; start a campaign like it anew."
            )
            return
        self._start()

    def land(self, result: EpisodeResult, verdict: Verdict) -> None:
        """A result was judged: what is learnt from is what the store keeps, and nothing else."""
        if verdict is not Verdict.KEPT and 0.0 < result.wall_s < inf:  # it came over the wire
            self.order.meter.discard(result.wall_s)
        self._landings[verdict](result)

    def _count(self, result: EpisodeResult) -> None:
        # It may have been proposed after it was brought, while its commit was still to come.
        self._leases.settle(self.order.campaign, result.index, wall_s=0.0)
        self._flight.land(msgspec.structs.replace(result, scene=None))
        self._hand_back()

    def _dispute(self, result: EpisodeResult) -> None:
        self._disputed.add(result.index)

    def _settle_disputes(self) -> None:
        """Where a second result differs from the first, the first one counts."""
        if self._disputed:
            for kept in self._store.episodes.finished(self.order.campaign, self._disputed):
                self._count(kept)
            self._disputed.clear()

    def _offer_again(self, result: EpisodeResult) -> None:
        """What the store does not take leaves its episode open, but not for ever."""
        task = self._flight.awaited(result.index)
        if task is None:
            return
        self._refused[result.index] += 1
        if self._refused[result.index] < MAX_REFUSALS:
            self._leases.offer(self.order.campaign, (task,))
            return
        self.ended = (
            f"The result of episode {result.index} was refused {MAX_REFUSALS} times: its seed, "
            "steps or shapes are not those of this campaign. Install the same eigenfail, and the "
            "same plug-ins, on all workers."
        )

    def _hand_back(self) -> None:
        """Let the learner observe the oldest round if it is whole and the learner is free."""
        if not self._learning and (results := self._flight.whole()):
            self._learning = self._handed_back = True
            self._link.say(Observed(results))

    def look(self) -> None:
        """Write down what the campaign is at from now on."""
        busy = self._leases.busy(self.order.campaign)
        idle = Phase.LEARNING if self._learning else Phase.WAITING
        self.order.meter.look(Phase.SIMULATING if busy else idle)

    def policy(self, version: int) -> Policy:
        """A policy that an open round needs."""
        return self._flight.policy(version)

    def stop(self) -> None:
        """Lease nothing more of it and end its learner; what is not finished stays open."""
        self._leases.withdraw(self.order.campaign)
        self._link.stop()
        self.order.meter.look(None)
