"""How a worker ends: in order, at once, or because it cannot work."""

import os
import signal
from threading import Thread

import psutil
import pytest

from eigenfail.values import CampaignSpec, EpisodeTask, PriorSource, episode_seed
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
from eigenfail_workers.worker import ending
from eigenfail_workers.worker.parent import Parent

pytestmark = pytest.mark.service

SETUP = Setup(1, CampaignSpec(name="t", method="monte_carlo", episodes=9, planner="idm").setup())
SELDOM_S = 2.0
FOR_EVER = "from eigenfail_workers.worker import ending; ending.PATIENCE_S = 1e9"
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


@pytest.mark.parametrize("signal_to_stop", [signal.SIGTERM, signal.SIGINT])
def test_a_worker_that_is_told_to_stop_waits_for_what_it_handed_in(
    hub, start_worker, eventually, signal_to_stop
) -> None:
    """Were it another hub by then, it would bring it again; it takes nothing new."""
    worker = start_worker(first=FOR_EVER)
    let_work(hub)
    stop(worker, signal_to_stop, eventually)
    hub.say(lease(1), Refusal("Who are you?"))
    assert [(claim.campaign, claim.index) for claim in hub.hear(Hello).claims] == [(1, 0)]
    hub.say(Welcome(heartbeat_s=SELDOM_S))
    assert hub.hear(Results).results[0].index == 0
    hub.say(Ack(1, (0,)))
    assert not isinstance(hub.hear(Goodbye | Results), Results)
    assert worker.wait(timeout=60) == 0


def test_a_second_signal_ends_its_patience(hub, start_worker, eventually) -> None:
    worker = start_worker(first=FOR_EVER)
    let_work(hub)
    stop(worker, signal.SIGINT, eventually)
    worker.send_signal(signal.SIGTERM)
    hub.hear(Goodbye)
    assert worker.wait(timeout=60) == 0


def test_who_has_nothing_to_hand_over_leaves_in_the_middle_of_an_episode(hub, start_worker) -> None:
    worker = start_worker(first=FOR_EVER)
    hub.hear(Hello)
    hub.say(Welcome(heartbeat_s=0.1), hanging(), lease(0))
    while hub.hear(Heartbeat).running != 0:
        pass
    worker.terminate()
    hub.hear(Goodbye)
    assert worker.wait(timeout=60) == 0


def hanging() -> Setup:
    spec = CampaignSpec(name="t", method="monte_carlo", episodes=9, planner="test_hangs")
    return Setup(1, spec.setup())


def serving(hub) -> tuple[Parent, Thread]:
    worker = Parent(hub.address, "w")
    thread = Thread(target=worker.serve)
    thread.start()
    let_work(hub)
    return worker, thread


def test_the_patience_has_an_end(hub, monkeypatch) -> None:
    monkeypatch.setattr(ending, "PATIENCE_S", 0.3)
    worker, thread = serving(hub)
    worker.leave()
    hub.hear(Goodbye)
    thread.join(timeout=60)
    assert not thread.is_alive()


def test_a_hub_that_says_goodbye_is_not_waited_for(hub, monkeypatch) -> None:
    monkeypatch.setattr(ending, "PATIENCE_S", 1e9)
    _, thread = serving(hub)
    hub.say(Goodbye())
    thread.join(timeout=60)
    assert not thread.is_alive()


def test_a_worker_on_which_no_inner_process_starts_leaves_its_episodes_to_others(
    hub, start_worker, tmp_path
) -> None:
    (tmp_path / "sitecustomize.py").write_text(NO_CHILD)
    worker = start_worker(PYTHONPATH=f"{tmp_path}{os.pathsep}{os.environ['PYTHONPATH']}")
    hub.hear(Hello)
    hub.say(Welcome(heartbeat_s=SELDOM_S), SETUP, lease(0, 1, 2))
    assert not isinstance(hub.hear(Goodbye | Results), Results)
    assert worker.wait(timeout=60) == 3
    (said,) = [line for line in (tmp_path / "said").read_text().splitlines() if "inner" in line]
    assert "No inner process can start here: 10 ended, one after the other" in said
    assert "(the last with exit status 1)" in said
