"""A campaign that runs on the hub: its learner process, its open rounds and its leases."""

import time
from collections.abc import Callable, Iterable
from typing import Any, NamedTuple

import msgspec
import structlog

from eigenfail.errors import ProtocolError
from eigenfail.values.campaign_spec import StopRules
from eigenfail.values.episode import EpisodeSetup
from eigenfail.values.learning import LearnerContext, Policy
from eigenfail.values.records import Job, Verdict
from eigenfail.wire.messages import Diverged, Message, Observed, Proposed, Start, Trouble
from eigenfail_services.bounds import NO_BOUNDS, SettingBounds
from eigenfail_services.hub import learner_link
from eigenfail_services.hub.commits import JudgedResult
from eigenfail_services.hub.leases import Leases
from eigenfail_services.hub.metrics import CampaignPhase, Metrics, TimeAccounting, Timeout, Work
from eigenfail_services.hub.open_rounds import OpenRounds
from eigenfail_services.store.codec import NoiseForm
from eigenfail_services.store.store import Store

log = structlog.get_logger()


class RunEnd(NamedTuple):
    """How a run ended.

    Attributes:
        problem: why it failed; empty if it did not.
        stopped_because: why it is complete: its budget was spent, a stop rule held, or the method
            had no more to propose; empty if it failed.
    """

    problem: str
    stopped_because: str = ""


def no_claim() -> None:
    """Return no claim: for a run that no other process can take over."""


class RunSpec(msgspec.Struct, frozen=True, eq=False):
    """The facts that the hub needs to run a campaign.

    Attributes:
        campaign: id of the campaign.
        setup: setup that its episodes share.
        method: name of its method.
        settings: settings of the method.
        seed: seed of the campaign.
        context: context of the learner.
        rules: rules that stop the campaign.
        observes: whether its learner uses the results of episodes.
        accounting: accounting of its time.
        claim: returns the job that gives the right to run it, which may be renewed meanwhile.
        weight: weight of its share of worker time.
    """

    campaign: int
    setup: EpisodeSetup
    method: str
    settings: dict[str, Any]
    seed: int
    context: LearnerContext
    rules: StopRules = StopRules()
    observes: bool = True
    accounting: TimeAccounting = msgspec.field(default_factory=TimeAccounting)
    claim: Callable[[], Job | None] = no_claim
    weight: float = 1.0


class CampaignRun:
    """Moves rounds from the learner to the leases, and complete rounds of results back.

    Args:
        spec: specification of the campaign.
        store: store of results and checkpoints.
        leases: leases of all campaigns.
        bounds: bounds of the learner, whose steps are to start, and to learn from a round.
        metrics: count the learner's steps and failures.

    Attributes:
        end: how the run ended; None while it goes on.
        resumed: whether it goes on from a checkpoint, so that workers may hold its episodes.
    """

    def __init__(
        self,
        spec: RunSpec,
        store: Store,
        leases: Leases,
        bounds: SettingBounds = NO_BOUNDS,
        metrics: Metrics | None = None,
    ) -> None:
        self.spec = spec
        self.end: RunEnd | None = None
        self.resumed = False
        self._store = store
        self._leases = leases
        leases.set_weight(spec.campaign, spec.weight)
        self._restarts = learner_link.LearnerRestarts()
        self._metrics = metrics or Metrics()
        self._bounds = bounds
        self._timeout = Timeout(bounds.time_s)
        self._handlers: dict[type, Callable[[Any], None]] = {
            Proposed: self._handle_proposed,
            Trouble: self._handle_trouble,
            Diverged: self._handle_diverged,
        }
        self._spawn_learner()

    @property
    def socket(self) -> Any:
        """The socket on which the learner's messages come."""
        return self._link.socket

    def _spawn_learner(self) -> None:
        """Spawn a learner process; leased episodes stay with their workers."""
        self._rounds = OpenRounds(
            self.spec.campaign,
            NoiseForm(self.spec.setup.disturbance.noise_shape, self.spec.context.channels),
            self._store,
            self._leases,
            observes=self.spec.observes,
        )
        self._learning_since_s: float | None = time.monotonic()
        self._has_observed = False
        self._unhandled: Message | None = None
        self._has_begun = False
        self._divergence: learner_link.LearnerFailure | None = None
        self._link = learner_link.LearnerLink(self._bounds, self._restarts.pause_s)
        self.update_phase()

    def _send_start(self) -> None:
        """Send a new learner its method, settings and checkpoint, for which the store is needed."""
        spec = self.spec
        try:
            checkpoint = self._store.checkpoints.recover(spec.campaign, spec.claim())
        except ProtocolError as error:
            self.end = RunEnd(str(error))
            return
        self.resumed = checkpoint is not None
        self._link.send(
            Start(spec.method, spec.settings, spec.context, spec.seed, checkpoint, spec.rules)
        )
        self._has_begun = True
        self._timeout.restart(self._restarts.pause_s)

    def poll(self) -> None:
        """Handle the learner's messages, and restart it if it is lost.

        Raises:
            StoreUnavailable: a message could not be stored; the next call handles it.
            ClaimLost: the campaign belongs to another process now; the message is not stored.
        """
        if not self._has_begun:
            self._send_start()
        if self._rounds.load_kept_results():
            self._send_complete_round()
        # The status is read before the messages, so that the last message of a process is handled.
        status = self._link.exit_status()
        while (message := self._unhandled or self._link.receive()) is not None:
            self._unhandled = message
            self._handlers[type(message)](message)
            self._unhandled = None
        if self.end is None and (failure := self._find_failure(status)) is not None:
            self._handle_failure(failure)

    def _handle_proposed(self, message: Proposed) -> None:
        # The checkpoint is stored before any of its episodes is leased. So a new learner or hub
        # proposes the same episodes again, and what workers hold stays valid.
        campaign, claim = self.spec.campaign, self.spec.claim()
        learned = message.estimate, message.trained_episodes
        self._store.checkpoints.save(campaign, message.checkpoint, *learned, claim)
        self._metrics.learner_s.observe(self.learner_s)
        self._learning_since_s = None
        # A learner that dies at its first round proposes that round again at each start, which
        # is no progress: only a round that was learned ends a row of failures.
        if self._has_observed:
            self._restarts.reset()
        if not message.rounds:
            self.end = RunEnd("", message.stopped_because)
            return
        self._rounds.open(message.rounds)
        self._send_complete_round()

    def _handle_trouble(self, message: Trouble) -> None:
        self.end = RunEnd(message.problem)

    def _handle_diverged(self, message: Diverged) -> None:
        self._divergence = learner_link.LearnerFailure(
            learner_link.FailureKind.DIVERGED, message.problem, message.remedy
        )

    def _find_failure(self, status: int | None) -> learner_link.LearnerFailure | None:
        if self._divergence is not None:
            return self._divergence
        if status is not None:
            return learner_link.describe_exit(status)
        if self._learning_since_s is not None and self._timeout.has_expired():
            return learner_link.describe_timeout(self._bounds.time_s)
        return None

    def _handle_failure(self, failure: learner_link.LearnerFailure) -> None:
        """Restart the learner from its last checkpoint, or end the campaign."""
        if problem := self._restarts.explain_end(failure):
            self.end = RunEnd(problem)
            return
        campaign = self.spec.campaign
        message = f"Campaign {campaign} goes on from its last checkpoint. {failure.problem}"
        self._store.events.append("learner.lost", message, campaign)
        log.warning("learner lost", campaign=campaign, problem=failure.problem)
        self._metrics.learners_lost.labels(failure.kind).inc()
        self._restarts.add(failure)
        # The next learner offers these episodes again; without it, nobody would take their
        # results.
        self._leases.unqueue_campaign(campaign)
        self._end_learner()
        self._spawn_learner()

    def take_verdicts(self, judged: Iterable[JudgedResult]) -> None:
        """Take in the store's verdicts on results; the learner observes what the store keeps."""
        for each in judged:
            if each.verdict is not Verdict.KEPT:
                self.spec.accounting.add_discarded(each.result.believed_wall_s)
            self._rounds.take_verdict(each.result, each.verdict)
        if self._rounds.problem:
            self.end = RunEnd(self._rounds.problem)
        self._send_complete_round()

    def _send_complete_round(self) -> None:
        """Send the oldest round to the learner, if it is complete and the learner is free."""
        if self._learning_since_s is None and (results := self._rounds.collector.pop_complete()):
            self._learning_since_s, self._has_observed = time.monotonic(), True
            self._timeout.restart()
            self._link.send(Observed(results))

    @property
    def learner_s(self) -> float:
        """How long the learner has been at its current step, 0 while it waits. [s]"""
        since_s = self._learning_since_s
        return 0.0 if since_s is None else time.monotonic() - since_s

    def work(self) -> Work:
        """Return the work that waits or is leased."""
        episodes = self._rounds.collector.count_pending()
        return Work(episodes, episodes * self._leases.episode_s(self.spec.campaign))

    def update_phase(self) -> None:
        """Account for the campaign's time by its activity from now on."""
        idle = CampaignPhase.WAITING if self._learning_since_s is None else CampaignPhase.LEARNING
        busy = self._leases.has_leases(self.spec.campaign)
        self.spec.accounting.set_phase(CampaignPhase.SIMULATING if busy else idle)

    def find_policy(self, version: int) -> Policy:
        """Return a policy of an open round.

        Raises:
            KeyError: no open round has it.
        """
        return self._rounds.collector.find_policy(version)

    def stop(self) -> None:
        """Withdraw its leases and end its learner; unfinished episodes stay open in the store."""
        self._leases.remove_campaign(self.spec.campaign)
        self._end_learner()

    def _end_learner(self) -> None:
        self._link.stop()
        self.spec.accounting.set_phase(None)
