"""One running campaign in the hub: its learner process, its rounds in flight, its leases."""

import time
from collections.abc import Callable
from math import inf
from typing import Any

import msgspec
import structlog

from eigenfail.contracts import Store
from eigenfail.errors import ProtocolError
from eigenfail.values import EpisodeResult, EpisodeSetup, LearnerContext, Policy, StopRules
from eigenfail.values.records import Job, Verdict
from eigenfail.wire.messages import Diverged, Message, Observed, Proposed, Start, Trouble
from eigenfail_services.bounds import NO_BOUNDS, Bounds
from eigenfail_services.hub.learner_link import LearnerLink
from eigenfail_services.hub.leases import Leases
from eigenfail_services.hub.losses import Kind, Loss, Losses, died, hung
from eigenfail_services.hub.meter import Meter, Phase
from eigenfail_services.hub.muster import Work
from eigenfail_services.hub.open_rounds import OpenRounds
from eigenfail_services.hub.patience import Patience
from eigenfail_services.hub.vitals import Vitals

log = structlog.get_logger()


def no_claim() -> None:
    """Of a run that nobody else can have claimed."""


class Order(msgspec.Struct, frozen=True, eq=False):
    """What the hub needs to know to run a campaign, and where it writes down its time.

    `claim` tells by what right it is run; it may be claimed anew meanwhile. The workers' time is
    shared by `weight`.
    """

    campaign: int
    setup: EpisodeSetup
    method: str
    settings: dict[str, Any]
    seed: int
    context: LearnerContext
    rules: StopRules = StopRules()
    meter: Meter = msgspec.field(default_factory=Meter)
    claim: Callable[[], Job | None] = no_claim
    weight: float = 1.0


class Run:
    """Moves rounds from the learner to the leases, and whole rounds of results back.

    Args:
        order: what is to be run.
        store: where results and checkpoints are kept.
        leases: of all campaigns.
        bounds: of the learner; a step is to begin, or to learn from a round and propose the next.
        vitals: where steps and losses of the learner are counted.

    Attributes:
        ended: why it is over, once it is: an empty text when the learner has no more to propose,
            else the trouble.
        because: why the learner has no more to propose.
        resumed: whether it goes on from a checkpoint, so that workers may hold some of it.
    """

    def __init__(
        self,
        order: Order,
        store: Store,
        leases: Leases,
        bounds: Bounds = NO_BOUNDS,
        vitals: Vitals | None = None,
    ) -> None:
        self.order = order
        self.ended: str | None = None
        self.because = ""
        self.resumed = False
        self._store = store
        self._leases = leases
        leases.weigh(order.campaign, order.weight)
        self._losses = Losses()
        self._vitals = vitals or Vitals()
        self._bounds = bounds
        self._patience = Patience(bounds.time_s)
        self._handlers: dict[type, Callable[[Any], None]] = {
            Proposed: self._proposed,
            Trouble: self._trouble,
            Diverged: self._diverged,
        }
        self._start()

    @property
    def socket(self) -> Any:
        """What to poll for the learner's words."""
        return self._link.socket

    def _start(self) -> None:
        """A new life of the learner, from its checkpoint; what is leased stays with its workers."""
        shape = self.order.setup.disturbance.shape
        self._rounds = OpenRounds(self.order.campaign, shape, self._store, self._leases)
        self._learning_since_s: float | None = time.monotonic()
        self._handed_back = False
        self._unhandled: Message | None = None
        self._briefed = False
        self._divergence: Loss | None = None
        self._link = LearnerLink(self._bounds, self._losses.pause_s)
        self.look()

    def _brief(self) -> None:
        """Tell a new learner what it is to be; without the store nobody can know."""
        order = self.order
        try:
            checkpoint = self._store.checkpoints.recover(order.campaign, order.claim())
        except ProtocolError as error:
            self.ended = str(error)
            return
        self.resumed = checkpoint is not None
        self._link.say(
            Start(order.method, order.settings, order.context, order.seed, checkpoint, order.rules)
        )
        self._briefed = True
        self._patience.renew(self._losses.pause_s)

    def tend(self) -> None:
        """Hear the learner, and bring it back if it is lost.

        Raises:
            StoreUnavailable: what it said could not be kept; it is handled at the next call.
            ClaimLost: the campaign is somebody else's by now; what it said is not kept.
        """
        if not self._briefed:
            self._brief()
        if self._rounds.count_those_kept():
            self._hand_back()
        status = self._link.exit_status()  # before listening: its last words are heard all the same
        self._listen()
        if self.ended is None and (loss := self._lost(status)) is not None:
            self._lose(loss)

    def _listen(self) -> None:
        while (message := self._unhandled or self._link.hear()) is not None:
            self._unhandled = message
            self._handlers[type(message)](message)
            self._unhandled = None

    def _proposed(self, message: Proposed) -> None:
        campaign = self.order.campaign
        told = message.estimate, message.trained_episodes
        self._store.checkpoints.save(campaign, message.checkpoint, *told, self.order.claim())
        self._vitals.learner_s.observe(self.learner_s)
        self._learning_since_s = None
        if self._handed_back:
            self._losses.forget()
        if not message.rounds:
            self.ended, self.because = "", message.because
            return
        self._rounds.open(message.rounds)
        self._hand_back()

    def _trouble(self, message: Trouble) -> None:
        self.ended = message.problem

    def _diverged(self, message: Diverged) -> None:
        self._divergence = Loss(Kind.DIVERGED, message.problem, message.remedy)

    def _lost(self, status: int | None) -> Loss | None:
        """Why the learner is no longer to be waited for; None while it is."""
        if self._divergence is not None:
            return self._divergence
        if status is not None:
            return died(status)
        if self._learning_since_s is not None and self._patience.is_over():
            return hung(self._bounds.time_s)
        return None

    def _lose(self, loss: Loss) -> None:
        """Another life from the last checkpoint, or the campaign's end."""
        if problem := self._losses.end_with(loss):
            self.ended = problem
            return
        campaign = self.order.campaign
        told = f"Campaign {campaign} goes on from its last checkpoint. {loss.problem}"
        self._store.events.append("learner.lost", told, campaign)
        log.warning("learner lost", campaign=campaign, problem=loss.problem)
        self._vitals.learners_lost.labels(loss.kind).inc()
        self._losses.add(loss)
        self._leases.suspend(campaign)
        self._end_learner()
        self._start()

    def land(self, result: EpisodeResult, verdict: Verdict) -> None:
        """A result was judged: what is learnt from is what the store keeps, and nothing else."""
        if verdict is not Verdict.KEPT and 0.0 < result.wall_s < inf:  # it came over the wire
            self.order.meter.discard(result.wall_s)
        self._rounds.land(result, verdict)
        self.ended = self._rounds.problem or self.ended
        self._hand_back()

    def _hand_back(self) -> None:
        """Let the learner observe the oldest round if it is whole and the learner is free."""
        if self._learning_since_s is None and (results := self._rounds.whole()):
            self._learning_since_s, self._handed_back = time.monotonic(), True
            self._patience.renew()
            self._link.say(Observed(results))

    @property
    def learner_s(self) -> float:
        """For how long the learner has been at its step; 0 while it waits. [s]"""
        since_s = self._learning_since_s
        return 0.0 if since_s is None else time.monotonic() - since_s

    def work(self) -> Work:
        """What there is for workers to do."""
        episodes = self._rounds.awaited()
        return Work(episodes, episodes * self._leases.pace_s(self.order.campaign))

    def look(self) -> None:
        """Write down what the campaign is at from now on."""
        busy = self._leases.busy(self.order.campaign)
        idle = Phase.WAITING if self._learning_since_s is None else Phase.LEARNING
        self.order.meter.look(Phase.SIMULATING if busy else idle)

    def policy(self, version: int) -> Policy:
        """A policy that an open round needs."""
        return self._rounds.policy(version)

    def stop(self) -> None:
        """Lease nothing more of it and end its learner; what is not finished stays open."""
        self._leases.withdraw(self.order.campaign)
        self._end_learner()

    def _end_learner(self) -> None:
        self._link.stop()
        self.order.meter.look(None)
