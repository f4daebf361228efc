"""A worker's two processes against a hub that this test plays, over a real socket."""

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from threading import Thread
from types import SimpleNamespace

import deadlines
import psutil
import pytest

from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail.values.episode import EpisodeTask, Outcome, PriorSource, episode_seed
from eigenfail.wire import messages
from eigenfail_workers.limits import Limits, read_limits
from eigenfail_workers.worker import child_process
from eigenfail_workers.worker.parent import Parent

pytestmark = pytest.mark.service


@pytest.fixture
def parent(hub) -> Iterator[Parent]:
    with serving(hub, episode_limit="600") as worker:
        yield worker


@pytest.fixture
def impatient(hub) -> Iterator[Parent]:
    """Of short patience with an episode, which ends in a hundredth of a second if it does."""
    with serving(hub, episode_limit="3") as worker:
        yield worker


@contextmanager
def serving(hub, episode_limit: str) -> Iterator[Parent]:
    worker = Parent(hub.address, "w", limits=read_limits(episode_limit=episode_limit))
    thread = Thread(target=worker.serve)
    thread.start()
    hello = hub.hear(messages.Hello)
    assert (hello.protocol, hello.worker) == (messages.PROTOCOL, "w")
    hub.say(messages.Welcome(heartbeat_s=0.2))
    yield worker
    worker.shut_down()
    worker.shut_down()
    thread.join(timeout=deadlines.PROCESS_S)
    assert not thread.is_alive()
    assert not [p for p in psutil.Process().children() if "worker.child" in " ".join(p.cmdline())]


def setup(planner: str) -> messages.Setup:
    spec = CampaignSpec(name="t", method="monte_carlo", episodes=9, planner=planner)
    return messages.Setup(1, spec.setup())


def lease(*indices: int) -> messages.Lease:
    return messages.Lease(
        1, tuple(EpisodeTask(i, episode_seed(0, i), PriorSource()) for i in indices)
    )


def child() -> psutil.Process:
    for guard in psutil.Process().children():
        if "worker.child" in " ".join(guard.cmdline()):
            return guard.children()[0]
    raise AssertionError("the worker has no child")


def test_leased_episodes_come_back_in_order(hub, parent) -> None:
    hub.say(setup("idm"), lease(0, 1, 2))
    results = [hub.hear(messages.Results).results[0] for _ in range(3)]
    assert [result.index for result in results] == [0, 1, 2]
    assert all(result.outcome is not Outcome.ERRORED for result in results)


def test_what_is_not_acknowledged_is_said_again_to_the_next_hub(hub, parent) -> None:
    hub.say(setup("idm"), lease(0, 1))
    first = [hub.hear(messages.Results).results[0] for _ in range(2)]
    hub.say(messages.Ack(1, (0,)), messages.Refusal("who are you?"))
    hub.hear(messages.Hello)
    hub.say(messages.Welcome(0.2))
    again = hub.hear(messages.Results).results[0]
    assert (again.index, again.digest()) == (1, first[1].digest())


@pytest.mark.fault(
    "SIGKILL of a worker's inner process",
    group="processes",
    outcome="The worker starts another inner process. The episode runs again, and is errored "
    "after the third time; no other episode is affected.",
)
def test_a_killed_child_costs_no_episode(hub, parent) -> None:
    hub.say(setup("idm"), lease(*range(40)))
    hub.hear(messages.Results)
    child().send_signal(signal.SIGKILL)
    indices = [hub.hear(messages.Results).results[0].index for _ in range(39)]
    assert sorted(indices) == list(range(1, 40))


@pytest.mark.fault(
    "planner or simulator that hangs",
    group="time",
    outcome="The inner process is killed at the time limit of an episode, also in compiled "
    "code that holds the GIL; the episode is errored, kind `infrastructure`.",
)
def test_an_episode_that_never_ends_is_given_up(hub, impatient) -> None:
    hub.say(setup("test_hangs"), lease(0))
    result = hub.hear(messages.Results).results[0]
    assert result.outcome is Outcome.ERRORED
    assert "longer than 3 s" in result.fault.message


@pytest.mark.fault("planner that ends its own process")
def test_an_episode_that_kills_its_process_is_given_up_after_three_tries(hub, parent) -> None:
    hub.say(setup("test_dies"), lease(0))
    result = hub.hear(messages.Results).results[0]
    assert result.fault.kind == "infrastructure"
    assert "exit status" in result.fault.message


@pytest.mark.fault(
    "planner that writes into the pipe of results",
    group="plug-ins",
    outcome="The inner process is ended and replaced; the episode is errored after three attempts.",
)
def test_an_episode_that_writes_into_the_pipe_of_results_is_given_up(hub, parent) -> None:
    hub.say(setup("test_scribbles"), lease(0))
    result = hub.hear(messages.Results).results[0]
    assert (result.index, result.fault.kind) == (0, "infrastructure")
    hub.say(setup("idm"), lease(1))
    assert hub.hear(messages.Results).results[0].outcome is not Outcome.ERRORED


def test_nonsense_is_passed_over(hub, parent) -> None:
    hub.say(b"", b"\x80\x04K\x01.", b"GET / HTTP/1.1\r\n\r\n", b"\xc1" * 1000)
    assert hub.hear(messages.Heartbeat)


def test_a_dropped_campaign_is_not_run_on(hub, parent) -> None:
    hub.say(setup("idm"), lease(*range(100)))
    hub.hear(messages.Results)
    hub.say(messages.Drop(1), setup("idm"), lease(500))
    indices = []
    while not indices or indices[-1] != 500:
        indices.append(hub.hear(messages.Results).results[0].index)
    assert len(indices) < 60


def test_an_episode_that_hangs_is_tried_anew_when_leased_again_after_its_campaign_was_dropped(
    hub, impatient
) -> None:
    hub.say(setup("test_hangs"), lease(0))
    while hub.hear(messages.Heartbeat).running != 0:
        pass
    hub.say(messages.Drop(1), setup("idm"), lease(0))
    assert [(r.index, r.fault) for r in hub.hear(messages.Results).results] == [(0, None)]


def test_only_the_first_of_many_welcomes_brings_the_outbox(hub, parent) -> None:
    hub.say(setup("idm"), lease(0))
    hub.hear(messages.Results)
    hub.say(*[messages.Welcome(heartbeat_s=5.0)] * 3, lease(1))
    assert [r.index for r in hub.hear(messages.Results).results] == [1]


@pytest.mark.fault("SIGSTOP of a worker")
def test_a_standstill_of_the_whole_worker_is_not_the_episodes_time(monkeypatch) -> None:
    now_s = [1000.0]
    monkeypatch.setattr(child_process, "time", SimpleNamespace(monotonic=lambda: now_s[0]))
    process = child_process.ChildProcess(Limits())
    try:
        (task,) = lease(0).tasks
        process.run(child_process.HeldEpisode(1, task))
        process.begun = 1
        now_s[0] += 3600.0
        assert not process.is_overdue(limit_s=5.0)
        for _ in range(6):
            now_s[0] += 1.0
            overdue = process.is_overdue(limit_s=5.0)
        assert overdue
    finally:
        process.end()
