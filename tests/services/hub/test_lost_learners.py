"""Learners that diverge, hang, die or eat memory: real processes, by a method of a stranger.

Store, supervisor and hub are real, too; the worker is the test's, and so is the learners' time.
"""

import contextlib
import errno
import os
import time
from collections.abc import Iterator
from itertools import count
from math import nan
from pathlib import Path

import deadlines
import numpy as np
import psutil
import pytest
import zmq
from accepted import accept_spec

from eigenfail import plugins
from eigenfail.values.campaign import Campaign, CampaignState
from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail.values.disturbance import NoiseTrajectory
from eigenfail.values.episode import EpisodeResult, EpisodeTask, Outcome
from eigenfail.values.measures import Measures
from eigenfail.wire import messages
from eigenfail_services.bounds import SettingBounds
from eigenfail_services.campaigns.analysis_jobs import AnalysisJobs
from eigenfail_services.campaigns.supervisor import Supervisor
from eigenfail_services.hub import learner_link, runs, worker_sessions
from eigenfail_services.hub.metrics import Timeout
from eigenfail_services.hub.server import Hub
from eigenfail_services.store.store import open_store

pytestmark = pytest.mark.service

LIMIT_S = 5.0
MEMORY_MIB = 400.0
DEADLINE_S = deadlines.PROCESS_S
UNMEASURED = 3
"""Every third result has measures that are none: what is stored of it has no measures at all."""


def learners() -> list[psutil.Process]:
    """Processes of learners, and what these have started."""
    found = []
    for child in psutil.Process().children():
        with contextlib.suppress(psutil.Error):  # it has just ended
            if "learner_process" in " ".join(child.cmdline()):
                found += [child, *child.children(recursive=True)]
    return found


def lives(process: psutil.Process) -> bool:
    try:
        return process.status() != psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return False


class House:
    """A service with one worker, whose results follow from their noise.

    Args:
        folder: where learners leave a mark each time that they go astray.
        now_s: the learners' time.
    """

    def __init__(self, folder: Path, now_s: list[float]) -> None:
        self._folder, self._now_s = folder, now_s
        self.store = open_store("memory://")
        self.hub = Hub(self.store, "tcp://127.0.0.1:*", learners=SettingBounds(LIMIT_S, MEMORY_MIB))
        self.supervisor = Supervisor(self.store, self.hub, AnalysisJobs(self.store, ""))
        self.worker: zmq.Socket[bytes] = zmq.Context.instance().socket(zmq.DEALER)
        self.worker.connect(self.hub.address)
        self._turns = count()
        self.hub.start()
        self._say(messages.Hello(messages.PROTOCOL, "w", 64))

    def create(self, **settings) -> int:
        """A campaign of five rounds."""
        spec = CampaignSpec(name="t", method="straying", episodes=20, settings=settings)
        return self.store.campaigns.create(accept_spec(spec)).id

    def astray(self, fault: str, times: int) -> int:
        """The same campaign, with a learner that goes astray."""
        return self.create(fault=fault, times=times, marks=str(self._folder / fault))

    def marks(self, fault: str) -> int:
        """How often it went astray."""
        marks = self._folder / fault
        return len(marks.read_text().splitlines()) if marks.exists() else 0

    def turn(self) -> None:
        """Whatever there is to do by now, or a little later."""
        self.supervisor.turn()
        if next(self._turns) % 50 == 0:
            self._say(messages.Heartbeat())
        if self.worker.poll(20):
            message = messages.read_hub_message(self.worker.recv())
            if isinstance(message, messages.Lease):
                results = tuple(result(task) for task in message.tasks)
                self._say(messages.Results(message.campaign, results))

    def ended(self, campaign: int) -> Campaign:
        """The campaign, once it has come to its end."""
        deadline_s = time.monotonic() + DEADLINE_S
        while (found := self.store.campaigns.get(campaign)).ended_ms is None:
            assert time.monotonic() < deadline_s, "the campaign does not end"
            self.turn()
        return found

    def sit_out(self, fault: str, times: int, processes: int = 1) -> None:
        """Once it hangs, with so many processes, let its time go by until they are gone."""
        deadline_s = time.monotonic() + DEADLINE_S
        while self.marks(fault) < times or len(hanging := learners()) < processes:
            assert time.monotonic() < deadline_s, "it does not hang"
            self.turn()
        while any(map(lives, hanging)):
            assert time.monotonic() < deadline_s, "it is not killed"
            self._now_s[0] += 1.0
            self.turn()

    def losses(self, campaign: int) -> list[str]:
        """What the event log says of lost learners."""
        events = self.store.events.after(0, 1000, campaign)
        return [event.message for event in events if event.kind == "learner.lost"]

    def close(self) -> None:
        self.worker.close(linger=0)
        self.hub.stop()
        self.store.close()

    def _say(self, message) -> None:
        self.worker.send(messages.encode(message))


def result(task: EpisodeTask) -> EpisodeResult:
    z = task.source.z
    robustness_m = nan if task.index % UNMEASURED == 0 else 1.0 + abs(float(z[0, 0])) + task.index
    return EpisodeResult(
        index=task.index,
        seed=task.seed,
        outcome=Outcome.SAFE,
        steps=len(z),
        noise=NoiseTrajectory(z, np.ones_like(z)),
        source=task.source_kind,
        measures=Measures(robustness_m),
    )


@pytest.fixture
def now_s(monkeypatch) -> list[float]:
    """The learners' time stands still unless a test lets it go on."""
    clock = [0.0]
    monkeypatch.setattr(runs, "Timeout", lambda limit_s: Timeout(limit_s, lambda: clock[0]))
    return clock


@pytest.fixture
def house(tmp_path, monkeypatch, now_s) -> Iterator[House]:
    record = tmp_path / "straying-0.0.dist-info"
    record.mkdir()
    (record / "METADATA").write_text("Metadata-Version: 2.1\nName: straying\nVersion: 0.0\n")
    points = "[eigenfail.methods]\nstraying = eigenfail_straying:Straying\n"
    (record / "entry_points.txt").write_text(points)
    path = os.pathsep.join(filter(None, [str(tmp_path), os.environ.get("PYTHONPATH")]))
    monkeypatch.setenv("PYTHONPATH", path)
    monkeypatch.syspath_prepend(tmp_path)
    plugins.list_entry_points.cache_clear()
    plugins.load.cache_clear()
    monkeypatch.setattr(worker_sessions, "ADOPTION_GRACE_S", 0.0)  # nobody else holds anything
    made = House(tmp_path, now_s)
    yield made
    made.close()
    plugins.list_entry_points.cache_clear()
    plugins.load.cache_clear()


@pytest.mark.fault(
    "learner or analysis that exhausts memory",
    group="processes",
    outcome="The kernel refuses it more memory. A learner starts again from its checkpoint, "
    "twice at most in a row; an analysis fails with the reason.",
)
@pytest.mark.fault("worker that reports NaN")
@pytest.mark.fault(
    "NaN or infinity in a learner",
    group="plug-ins",
    outcome="It starts again from its checkpoint, with an event; the second time in a row the"
    " campaign ends as dead and names the remedy. No such policy leaves the hub.",
)
@pytest.mark.parametrize("fault", ["diverge", "policy", "noise", "estimate", "die", "eat"])
def test_a_learner_that_is_lost_once_changes_nothing(house: House, fault: str) -> None:
    undisturbed, disturbed = house.create(), house.astray(fault, times=1)
    ended = [house.ended(campaign) for campaign in (undisturbed, disturbed)]
    assert [each.state for each in ended] == [CampaignState.DONE] * 2
    assert [each.counts.completed for each in ended] == [20] * 2
    assert house.losses(undisturbed) == []
    (told,) = house.losses(disturbed)
    assert told.startswith(f"Campaign {disturbed} goes on from its last checkpoint. ")
    first, second = map(house.store.episodes.digest, (undisturbed, disturbed))
    assert first == second


@pytest.mark.fault("NaN or infinity in a learner")
@pytest.mark.parametrize(
    ("fault", "problem", "remedy"),
    [
        ("diverge", "The toy diverged.", "Lower its learning_rate."),
        ("policy", "Policy 0, which the learner proposed, holds a number that is NaN", "Lower"),
    ],
)
def test_one_that_diverges_again_from_its_checkpoint_ends_the_campaign(
    house: House, fault: str, problem: str, remedy: str
) -> None:
    campaign = house.astray(fault, times=1000)
    ended = house.ended(campaign)
    assert ended.state is CampaignState.DEAD
    assert ended.stopped_because.startswith(problem)
    assert "failed 2 times in a row" in ended.stopped_because
    assert remedy in ended.stopped_because
    assert len(house.losses(campaign)) == 1
    assert house.marks(fault) == 2
    rows = house.store.episodes.page(campaign, 100).items
    assert {row.source for row in rows} == {"trajectory"}, "a policy of NaN was sent out"
    assert ended.counts.completed == 8


@pytest.mark.fault(
    "no process available for a learner or an analysis",
    group="processes",
    outcome="A learner is tried again after 1 s and after another 5 s, like any lost learner;"
    " an analysis fails with the reason.",
)
def test_one_that_cannot_be_started_is_a_loss_like_any_other(house: House, monkeypatch) -> None:
    popen, refusals = learner_link.subprocess.Popen, [OSError(errno.EAGAIN, "Try again")]

    def refused_once(command, **named):
        if refusals:
            raise refusals.pop()
        return popen(command, **named)

    monkeypatch.setattr(learner_link.subprocess, "Popen", refused_once)
    campaign = house.create()
    assert house.ended(campaign).state is CampaignState.DONE
    (told,) = house.losses(campaign)
    assert told.endswith(f"died with exit status {os.EX_OSERR}.")


@pytest.mark.fault("no process available for a learner or an analysis")
def test_a_machine_that_has_no_process_left_for_seconds_ends_no_campaign(
    house: House, monkeypatch
) -> None:
    popen, until_s = learner_link.subprocess.Popen, time.monotonic() + 2.0

    def refused_for_a_while(command, **named):
        if time.monotonic() < until_s:
            raise OSError(errno.EAGAIN, "Try again")
        return popen(command, **named)

    monkeypatch.setattr(learner_link.subprocess, "Popen", refused_for_a_while)
    campaign = house.create()
    assert house.ended(campaign).state is CampaignState.DONE
    assert len(house.losses(campaign)) == 2


@pytest.mark.fault(
    "learner that hangs",
    group="time",
    outcome="It is killed after an hour at one step with all that it started, also in C with "
    "the GIL held, and starts again from its checkpoint. The second time in a row the"
    " campaign ends as dead and names the remedy.",
)
@pytest.mark.parametrize(("fault", "processes"), [("sleep", 2), ("hold", 1)])
def test_a_learner_that_hangs_is_killed_with_all_it_started_and_goes_on(
    house: House, fault: str, processes: int
) -> None:
    undisturbed, disturbed = house.create(), house.astray(fault, times=1)
    house.ended(undisturbed)
    house.sit_out(fault, 1, processes)
    assert house.ended(disturbed).state is CampaignState.DONE
    (told,) = house.losses(disturbed)
    assert "took more than 5 s over one step, and was killed" in told
    first, second = map(house.store.episodes.digest, (undisturbed, disturbed))
    assert first == second


@pytest.mark.fault("learner that hangs")
def test_one_that_hangs_again_ends_the_campaign(house: House) -> None:
    campaign = house.astray("hold", times=1000)
    house.sit_out("hold", 1)
    house.sit_out("hold", 2)
    ended = house.ended(campaign)
    assert ended.state is CampaignState.DEAD
    assert "--learner-limit" in ended.stopped_because


@pytest.mark.parametrize(
    ("method", "settings", "told"),
    [
        ("gone", {}, "'gone' is not known"),
        ("straying", {"gone": 1}, "gone"),
        ("ensemble", {"method": "gone"}, "gone"),
    ],
)
def test_a_method_that_is_gone_or_refuses_its_settings_ends_its_campaign(
    house: House, method: str, settings: dict, told: str
) -> None:
    """It was there when the campaign was created, and the claim does not look for it again."""
    spec = CampaignSpec(name="t", method=method, episodes=20, settings=settings)
    ended = house.ended(house.store.campaigns.create(accept_spec(spec)).id)
    assert ended.state is CampaignState.DEAD
    assert told in ended.stopped_because
    assert house.losses(ended.id) == []
