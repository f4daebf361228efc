"""How a worker ends: in order, at once, or because it cannot work."""

import os
import resource
import signal
import subprocess
import sys
from collections.abc import Iterator
from threading import Thread

import deadlines
import psutil
import pytest

from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail.values.episode import EpisodeTask, PriorSource, episode_seed
from eigenfail.wire.messages import (
    Ack,
    Goodbye,
    Heartbeat,
    Hello,
    Lease,
    Refusal,
    Results,
    Setup,
    Welcome,
)
from eigenfail_workers.worker import parent
from eigenfail_workers.worker.parent import Parent

pytestmark = pytest.mark.service

SETUP = Setup(1, CampaignSpec(name="t", method="monte_carlo", episodes=9, planner="idm").setup())
SELDOM_S = 2.0
STANDARD_FILES = 3
FOR_EVER = "from eigenfail_workers.worker import parent; parent.HAND_OVER_S = 1e9"
LOG_TO_STDERR = """
import structlog, sys
structlog.configure(logger_factory=structlog.PrintLoggerFactory(sys.stderr))
"""
NO_CHILD = """
import os, sys
if "eigenfail_workers.worker.child" in sys.orig_argv:
    os._exit(1)
"""


def lease(*indices: int) -> Lease:
    return Lease(1, tuple(EpisodeTask(i, episode_seed(0, i), PriorSource()) for i in indices))


def let_work(hub) -> None:
    """A worker that has handed in one episode, which is not acknowledged."""
    hub.hear(Hello)
    hub.say(Welcome(heartbeat_s=SELDOM_S), SETUP, lease(0))
    assert hub.hear(Results).results[0].index == 0


def stop(worker, signal_to_stop: int, eventually) -> None:
    """Ask it to stop; it has heard that when its inner process is gone."""
    worker.send_signal(signal_to_stop)
    eventually(lambda: not psutil.Process(worker.pid).children())


@pytest.mark.fault(
    "SIGTERM or Ctrl-C of a worker, once or twice",
    group="processes",
    outcome="The worker hands over its finished episodes for 10 s at most and exits with 0; a"
    " second signal ends it at once.",
)
@pytest.mark.parametrize("signal_to_stop", [signal.SIGTERM, signal.SIGINT])
def test_a_worker_that_is_told_to_stop_waits_for_what_it_handed_in(
    hub, start_worker, eventually, signal_to_stop
) -> None:
    """Were it another hub by then, it would bring it again; it takes nothing new."""
    worker = start_worker(first=FOR_EVER)
    let_work(hub)
    stop(worker, signal_to_stop, eventually)
    hub.say(lease(1), Refusal("Who are you?"))
    assert [(claim.campaign, claim.index) for claim in hub.hear(Hello).holdings] == [(1, 0)]
    hub.say(Welcome(heartbeat_s=SELDOM_S))
    assert hub.hear(Results).results[0].index == 0
    hub.say(Ack(1, (0,)))
    assert not isinstance(hub.hear(Goodbye | Results), Results)
    assert worker.wait(timeout=deadlines.PROCESS_S) == 0


@pytest.mark.fault("SIGTERM or Ctrl-C of a worker, once or twice")
def test_a_second_signal_ends_its_patience(hub, start_worker, eventually) -> None:
    worker = start_worker(first=FOR_EVER)
    let_work(hub)
    stop(worker, signal.SIGINT, eventually)
    worker.send_signal(signal.SIGTERM)
    hub.hear(Goodbye)
    assert worker.wait(timeout=deadlines.PROCESS_S) == 0


def test_who_has_nothing_to_hand_over_leaves_in_the_middle_of_an_episode(hub, start_worker) -> None:
    worker = start_worker(first=FOR_EVER)
    hub.hear(Hello)
    hub.say(Welcome(heartbeat_s=0.1), hanging(), lease(0))
    while hub.hear(Heartbeat).running != 0:
        pass
    worker.terminate()
    hub.hear(Goodbye)
    assert worker.wait(timeout=deadlines.PROCESS_S) == 0


def hanging() -> Setup:
    spec = CampaignSpec(name="t", method="monte_carlo", episodes=9, planner="test_hangs")
    return Setup(1, spec.setup())


@pytest.fixture
def serving(hub) -> Iterator[tuple[Parent, Thread]]:
    worker = Parent(hub.address, "w")
    thread = Thread(target=worker.serve, daemon=True)
    thread.start()
    try:
        let_work(hub)
        yield worker, thread
    finally:
        worker.shut_down()
        worker.shut_down()
        thread.join(timeout=deadlines.PROCESS_S)


def test_the_patience_has_an_end(hub, serving, monkeypatch) -> None:
    monkeypatch.setattr(parent, "HAND_OVER_S", 0.3)
    worker, thread = serving
    worker.shut_down()
    hub.hear(Goodbye)
    thread.join(timeout=deadlines.PROCESS_S)
    assert not thread.is_alive()


def test_a_hub_that_says_goodbye_still_may_say_what_it_has(hub, serving, monkeypatch) -> None:
    monkeypatch.setattr(parent, "HAND_OVER_S", 1e9)
    _, thread = serving
    hub.say(Goodbye())
    assert isinstance(hub.hear(Goodbye | Heartbeat), Heartbeat)
    hub.say(Ack(1, (0,)))
    thread.join(timeout=deadlines.PROCESS_S)
    assert not thread.is_alive()


def test_who_says_goodbye_twice_is_not_waited_for(hub, serving, monkeypatch) -> None:
    monkeypatch.setattr(parent, "HAND_OVER_S", 1e9)
    _, thread = serving
    hub.say(Goodbye())
    hub.say(Goodbye())
    thread.join(timeout=deadlines.PROCESS_S)
    assert not thread.is_alive()


@pytest.mark.fault("inner process that cannot be started")
def test_a_worker_on_which_no_inner_process_starts_leaves_its_episodes_to_others(
    hub, start_worker, tmp_path
) -> None:
    (tmp_path / "sitecustomize.py").write_text(NO_CHILD)
    worker = start_worker(PYTHONPATH=f"{tmp_path}{os.pathsep}{os.environ['PYTHONPATH']}")
    hub.hear(Hello)
    hub.say(Welcome(heartbeat_s=SELDOM_S), SETUP, lease(0, 1, 2))
    assert not isinstance(hub.hear(Goodbye | Results), Results)
    assert worker.wait(timeout=deadlines.PROCESS_S) == 3
    (said,) = [line for line in (tmp_path / "said").read_text().splitlines() if "inner" in line]
    assert "No inner process can start here: 10 ended, one after the other" in said
    assert "(the last with exit status 1)" in said


@pytest.mark.fault(
    "inner process that cannot be started",
    group="processes",
    outcome="The worker tries ten times, one second apart, then exits with 3; its episodes go"
    " to others.",
)
def test_what_the_system_does_not_start_is_tried_again(hub, start_worker, tmp_path, eventually):
    """Here it has no file left for a pipe; what a worker needs it has open by then."""
    worker = start_worker(first=LOG_TO_STDERR)
    let_work(hub)
    plenty = resource.prlimit(worker.pid, resource.RLIMIT_NOFILE)
    resource.prlimit(worker.pid, resource.RLIMIT_NOFILE, (STANDARD_FILES, plenty[1]))
    for child in psutil.Process(worker.pid).children():
        child.kill()
    hub.say(Ack(1, (0,)), lease(1))
    eventually(lambda: "No inner process can be started here" in (tmp_path / "said").read_text())
    resource.prlimit(worker.pid, resource.RLIMIT_NOFILE, plenty)
    assert hub.hear(Results).results[0].index == 1
    assert worker.poll() is None


AS_RAY_DOES = """
from eigenfail_workers.worker import actor
actor.PAUSE_S = 0.0
actor.WorkerActor().run({address!r}, "w")
"""


@pytest.mark.fault("SIGKILL of a Ray worker")
def test_the_process_of_an_actor_ends_so_that_ray_starts_another(hub, tmp_path) -> None:
    (tmp_path / "sitecustomize.py").write_text(NO_CHILD)
    path = f"{tmp_path}{os.pathsep}{os.environ['PYTHONPATH']}"
    script = AS_RAY_DOES.format(address=hub.address) + "print('raised nothing')"
    ended = subprocess.run(
        [sys.executable, "-c", script],
        env=os.environ | {"PYTHONPATH": path},
        capture_output=True,
        text=True,
        timeout=deadlines.PROCESS_S,
        check=False,
    )
    assert (ended.returncode, "raised nothing" in ended.stdout) == (3, False)
    assert "No inner process can start here: 10 ended" in ended.stderr
