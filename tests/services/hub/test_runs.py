"""A run between a learner, a store and workers that the test plays: no trouble loses an episode."""

import sys
from collections import deque
from math import inf, nan

import deadlines
import msgspec
import numpy as np
import pytest
from accepted import accept_spec

from eigenfail.errors import StoreUnavailable
from eigenfail.values import episode
from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail.values.estimates import Estimate
from eigenfail.values.learning import LearnerContext, Round
from eigenfail.values.measures import Measures
from eigenfail.values.records import Delivery, Verdict
from eigenfail.wire.messages import PROTOCOL, Hello, Observed, Proposed, Start, Trouble, encode
from eigenfail_services.bounds import NO_BOUNDS
from eigenfail_services.hub import learner_link, open_rounds, runs
from eigenfail_services.hub.commits import JudgedResult
from eigenfail_services.hub.learner_link import LearnerLink, encrypt_caller, encrypt_listener
from eigenfail_services.hub.leases import Leases
from eigenfail_services.hub.metrics import CampaignPhase
from eigenfail_services.hub.runs import CampaignRun, RunEnd, RunSpec
from eigenfail_services.store.store import open_store

SPEC = CampaignSpec(name="t", method="monte_carlo", episodes=9)
TASKS = tuple(episode.EpisodeTask(index, index, episode.PriorSource()) for index in range(2))


class PlayedLink:
    """The learner's part is the test's."""

    def __init__(self) -> None:
        self.said: list = []
        self.to_say: deque = deque()
        self.status: int | None = None

    def send(self, message) -> None:
        self.said.append(message)

    def receive(self):
        return self.to_say.popleft() if self.to_say else None

    def exit_status(self) -> int | None:
        return self.status

    def stop(self) -> None:
        pass


class Stage:
    """A run of one campaign."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self._patch = monkeypatch
        self.links: list[PlayedLink] = []
        monkeypatch.setattr(runs.learner_link, "LearnerLink", self._link)
        self.store = open_store("memory://")
        self.campaign = self.store.campaigns.create(accept_spec(SPEC)).id
        self.leases = Leases()
        self.leases.open_session(b"w", Hello(PROTOCOL, "w", 256), 0.0)
        nothing = np.zeros((0, 5, 2), np.float32)
        context = LearnerContext(0, SPEC.episodes, 5, nothing)
        spec = RunSpec(self.campaign, SPEC.setup(), SPEC.method, {}, 0, context)
        self.run = CampaignRun(spec, self.store, self.leases)

    def _link(self, _bounds, _pause_s) -> PlayedLink:
        self.links.append(PlayedLink())
        return self.links[-1]

    def without(self, part: str, verb: str) -> None:
        """The next turn fails, and the one after that does not."""

        def away(*_):
            raise StoreUnavailable("The disk is full.")

        with self._patch.context() as patch:
            patch.setattr(getattr(self.store, part), verb, away)
            with pytest.raises(StoreUnavailable):
                self.run.poll()
        self.run.poll()

    def lease_round(self) -> None:
        """Have the learner propose both episodes, and a worker get them."""
        self.run.poll()
        propose(self)
        self.run.poll()
        self.leased()

    def leased(self) -> list[int]:
        return [task.index for a in self.leases.assign() for task in a.tasks]

    def deliver(self, *results) -> list[Verdict]:
        """Results come, are committed, and land."""
        verdicts = self.store.episodes.commit(self.campaign, [Delivery(r, "w") for r in results])
        for result, verdict in zip(results, verdicts, strict=True):
            self.leases.complete(self.campaign, result.index, 0.1)
            self.run.take_verdicts([JudgedResult(b"w", self.campaign, result, verdict)])
        return verdicts

    def shown(self) -> tuple[episode.EpisodeResult, ...]:
        """The round that the learner was shown."""
        (shown,) = (m for m in self.links[-1].said if isinstance(m, Observed))
        return shown.results

    def observed(self) -> list[str]:
        """The kinds of the faults in it."""
        return [result.fault.kind for result in self.shown()]


@pytest.fixture
def stage(monkeypatch: pytest.MonkeyPatch) -> Stage:
    return Stage(monkeypatch)


def result(index: int, kind: str = "input"):
    return episode.unrunnable(TASKS[index], episode.EpisodeFault(kind, "test"))


def propose(stage: Stage) -> None:
    stage.links[-1].to_say.append(Proposed((Round(0, TASKS),), b"checkpoint"))


def test_a_learner_that_begins_while_the_store_is_away_is_briefed_later(stage: Stage) -> None:
    stage.without("checkpoints", "recover")
    assert [type(message) for message in stage.links[-1].said] == [Start]


@pytest.mark.fault("disk full")
@pytest.mark.parametrize(("part", "verb"), [("checkpoints", "save"), ("episodes", "finished")])
def test_a_round_proposed_while_the_store_is_away_is_run(stage: Stage, part, verb) -> None:
    stage.run.poll()
    propose(stage)
    stage.without(part, verb)
    assert sorted(stage.leased()) == [0, 1]


def test_what_a_learner_tells_is_kept_with_its_checkpoint(stage: Stage) -> None:
    told = Estimate(by="subset simulation", episodes=2, problem="Not known yet.")
    stage.run.poll()
    said = Proposed((Round(0, TASKS),), b"checkpoint", estimate=told, trained_episodes=170)
    stage.links[-1].to_say.append(said)
    stage.run.poll()
    found = stage.store.campaigns.get(stage.campaign)
    assert (found.estimate, found.trained_episodes) == (told, 170)
    assert stage.store.checkpoints.load(stage.campaign) == b"checkpoint"


@pytest.mark.fault("second result of an episode with another digest")
def test_what_is_learnt_from_is_what_the_store_keeps(stage: Stage) -> None:
    stage.lease_round()
    assert stage.deliver(result(0), result(0, "solver")) == [Verdict.KEPT, Verdict.ALARM]
    stage.deliver(result(1))
    assert stage.observed() == ["input", "input"]


def test_a_result_kept_elsewhere_counts_although_ours_has_its_digest(stage: Stage) -> None:
    stage.lease_round()
    kept, again = (msgspec.structs.replace(result(0), wall_s=wall_s) for wall_s in (1.0, 2.0))
    stage.store.episodes.commit(stage.campaign, [Delivery(kept, "another hub's")])
    assert stage.deliver(again, result(1)) == [Verdict.DUPLICATE, Verdict.KEPT]
    stage.run.poll()
    assert [shown.wall_s for shown in stage.shown()] == [1.0, 0.0]


def test_a_learner_is_shown_what_one_that_begins_again_will_read(stage: Stage) -> None:
    stage.lease_round()
    odd = (Measures(nan, severity=2.0), Measures(1.0, min_ttc_s=inf, clipped_steps=-1))
    made = [msgspec.structs.replace(result(i), measures=odd[i], wall_s=nan) for i in range(2)]
    stage.deliver(*made)
    stored = stage.store.episodes.finished(stage.campaign, [0, 1])
    shown = stage.shown()
    assert [(each.measures, each.wall_s) for each in shown] == [(None, 0.0), (Measures(1.0), 0.0)]
    assert encode(Observed(shown)) == encode(Observed(tuple(stored)))


def test_an_episode_that_the_store_refuses_again_and_again_ends_the_campaign(stage: Stage) -> None:
    stage.lease_round()
    misfit = msgspec.structs.replace(result(0), steps=-1)
    for _ in range(open_rounds.MAX_REFUSALS):
        assert stage.run.end is None
        stage.deliver(misfit)
        stage.leased()
    assert stage.run.end is not None
    assert "episode 0 was refused" in stage.run.end.problem


def test_the_last_words_of_a_learner_are_heard(stage: Stage) -> None:
    stage.run.poll()
    link = stage.links[-1]

    def die() -> int:
        """Between two looks, and not without a word."""
        link.to_say.append(Trouble("It diverged."))
        return 0

    link.exit_status = die  # type: ignore[method-assign]
    stage.run.poll()
    assert stage.run.end == RunEnd("It diverged.")


def phases(stage: Stage) -> list[CampaignPhase | None]:
    """What the run wrote down, from now on."""
    seen: list[CampaignPhase | None] = []
    stage.run.spec.accounting.set_phase = seen.append  # type: ignore[method-assign]
    return seen


def test_what_a_campaign_is_at_is_written_down(stage: Stage) -> None:
    seen = phases(stage)
    stage.run.update_phase()
    stage.run.poll()
    propose(stage)
    stage.run.poll()
    stage.run.update_phase()  # nobody has it yet
    stage.leased()
    stage.run.update_phase()
    stage.deliver(result(0))
    stage.run.update_phase()
    stage.deliver(result(1))
    stage.run.update_phase()  # the round is whole, the learner has it
    stage.run.stop()
    work = [CampaignPhase.SIMULATING, CampaignPhase.SIMULATING]
    assert seen == [
        CampaignPhase.LEARNING,
        CampaignPhase.WAITING,
        *work,
        CampaignPhase.LEARNING,
        None,
    ]


def test_what_is_thrown_away_is_written_down(stage: Stage) -> None:
    stage.lease_round()
    kept, again, other, misfit = (
        msgspec.structs.replace(made, wall_s=wall_s)
        for made, wall_s in (
            (result(0), 1.0),
            (result(0), 2.0),
            (result(0, "solver"), 4.0),
            (msgspec.structs.replace(result(1), steps=-1), 8.0),
        )
    )
    stage.deliver(kept, again, other, misfit)
    stage.deliver(msgspec.structs.replace(again, wall_s=float("nan")))
    assert stage.run.spec.accounting.take().discarded_s == 14.0


@pytest.fixture
def keys(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """What learners are told, so that a test can speak in their place."""
    told: list[str] = []
    monkeypatch.setattr(
        learner_link,
        "encrypt_listener",
        lambda socket: told.append(encrypt_listener(socket)) or told[-1],
    )
    return told


@pytest.fixture
def mute(keys: list[str], monkeypatch: pytest.MonkeyPatch) -> LearnerLink:
    """A learner that dies before it ever connects."""
    monkeypatch.setattr(learner_link.sys, "executable", "/bin/false")
    link = LearnerLink(NO_BOUNDS)
    monkeypatch.undo()
    return link


@pytest.mark.service
@pytest.mark.timeout(deadlines.TEST_S)
def test_a_learner_that_never_connects_keeps_nobody_waiting(mute: LearnerLink) -> None:
    for _ in range(3):
        mute.send(Observed(()))
    assert mute.receive() is None
    mute.stop()
    assert mute.exit_status() == 1
    assert sys.executable != "/bin/false"


@pytest.mark.service
def test_words_that_cannot_be_read_are_trouble(mute: LearnerLink, keys: list[str]) -> None:
    import zmq

    learner = zmq.Context.instance().socket(zmq.PAIR)
    encrypt_caller(learner, keys[0])
    learner.connect(mute.socket.getsockopt_string(zmq.LAST_ENDPOINT))
    learner.send(b"\xc1")
    assert mute.socket.poll(60_000)
    trouble = mute.receive()
    assert isinstance(trouble, Trouble)
    learner.close(linger=0)
    mute.stop()
