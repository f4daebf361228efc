"""Planners that a stranger might bring, in real processes: each costs what it did itself."""

import os
from collections.abc import Iterator
from itertools import count
from pathlib import Path
from threading import Thread

import numpy as np
import psutil
import pytest

from eigenfail.values import CampaignSpec, EpisodeTask, Outcome, TrajectorySource
from eigenfail.wire.messages import Ack, Hello, Lease, Results, Setup, Welcome
from eigenfail_workers.worker.limits import Limits
from eigenfail_workers.worker.parent import Parent

pytestmark = pytest.mark.service

LIMITS = Limits(memory_mib=320.0, files=256, threads=32)
BAD = 1
SELDOM_S = 60.0
"""Who waits for long between two words of the worker need not answer any of them."""

campaigns = count(1)


@pytest.fixture(scope="module")
def worker(lasting_hub) -> Iterator[Parent]:
    """One worker for all that has no need of its own: it outlives every planner."""
    worker = Parent(lasting_hub.address, "w", limits=LIMITS)
    thread = Thread(target=worker.serve, daemon=True)
    thread.start()
    try:
        lasting_hub.hear(Hello)
        lasting_hub.say(Welcome(heartbeat_s=SELDOM_S))
        yield worker
    finally:
        worker.leave()
        worker.leave()
        thread.join(timeout=60)
    assert not thread.is_alive()


def setup(campaign: int, planner: str, **settings: str) -> Setup:
    spec = CampaignSpec(
        name="t",
        method="monte_carlo",
        episodes=9,
        simulator="point_mass",
        planner=planner,
        planner_settings=settings,
    )
    return Setup(campaign, spec.setup())


def task(index: int, *, leaps: bool) -> EpisodeTask:
    """An episode without noise; or with so much in its first step that the planner misbehaves."""
    z = np.array([[30.0 if leaps else 0.0, 0.0]], np.float32)
    return EpisodeTask(index, index, TrajectorySource(z))


def run_four(hub, way: str, folder: Path) -> dict[int, object]:
    """What four episodes of a campaign come to, of which one is bad: faults by index."""
    campaign = next(campaigns)
    tasks = tuple(task(index, leaps=index == BAD) for index in range(4))
    hub.say(setup(campaign, "test_misbehaves", way=way, folder=str(folder)), Lease(campaign, tasks))
    results = [hub.hear(Results).results[0] for _ in tasks]
    hub.say(Ack(campaign, tuple(range(4))))
    return {result.index: result.fault for result in results}


def is_gone(pid: int) -> bool:
    try:
        return psutil.Process(pid).status() == psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return True


def forked(folder: Path) -> list[int]:
    return [int(file.name) for file in folder.iterdir() if file.name.isdecimal()]


MEMORY = "320 MiB is the limit (--memory-limit of the worker, or EIGENFAIL_MEMORY_LIMIT_MIB)"
THREADS = "threads and processes, where 32 is the limit"


COSTS = {
    "leaks": ("infrastructure", MEMORY),
    "starts threads": ("infrastructure", THREADS),
    "starts processes": ("infrastructure", THREADS),
    "opens files": ("planner", "Too many open files"),
    "wants too much": ("planner", "MemoryError"),
    "segfaults": ("infrastructure", "killed its process (exit status -11)"),
    "forks and dies": ("infrastructure", "killed its process (exit status 7)"),
    "interrupts": ("infrastructure", "killed its process (exit status -2)"),
    "mumbles": ("infrastructure", "killed its process (exit status -9)"),
    "leaves": ("infrastructure", "killed its process (exit status 4)"),
}


@pytest.mark.parametrize("way", COSTS)
def test_a_bad_planner_costs_the_episode_in_which_it_is_bad(
    lasting_hub, worker, tmp_path, way
) -> None:
    faults = run_four(lasting_hub, way, tmp_path)
    assert faults.keys() == {0, 1, 2, 3}
    bad = faults.pop(BAD)
    kind, cause = COSTS[way]
    assert (bad.kind, cause in bad.message) == (kind, True), bad
    assert set(faults.values()) == {None}


@pytest.mark.parametrize("way", ["prints", "reads"])
def test_who_prints_much_or_waits_for_input_costs_nothing(
    lasting_hub, worker, tmp_path, way
) -> None:
    assert set(run_four(lasting_hub, way, tmp_path).values()) == {None}


def test_files_that_a_planner_forgets_cost_no_episode(lasting_hub, worker) -> None:
    campaign, episodes = next(campaigns), range(12)
    tasks = tuple(task(index, leaps=False) for index in episodes)
    lasting_hub.say(setup(campaign, "test_forgets_files"), Lease(campaign, tasks))
    results = [lasting_hub.hear(Results).results[0] for _ in episodes]
    assert sorted(result.index for result in results) == list(episodes)
    assert all(result.outcome is not Outcome.FAILED for result in results)
    lasting_hub.say(Ack(campaign, tuple(episodes)))


def test_what_a_planner_started_does_not_outlive_its_process(
    lasting_hub, worker, tmp_path, eventually
) -> None:
    run_four(lasting_hub, "forks and dies", tmp_path)
    assert len(forked(tmp_path)) == 3
    eventually(lambda: all(map(is_gone, forked(tmp_path))))


def test_nothing_outlives_a_worker_that_is_killed(hub, start_worker, tmp_path, eventually) -> None:
    worker = start_worker()
    hub.hear(Hello)
    hub.say(
        Welcome(SELDOM_S), setup(1, "test_misbehaves", way="forks and hangs", folder=str(tmp_path))
    )
    hub.say(Lease(1, (task(0, leaps=True),)))
    eventually(lambda: forked(tmp_path))
    started = [child.pid for child in psutil.Process(worker.pid).children(recursive=True)]
    assert set(forked(tmp_path)) < set(started)
    worker.kill()
    eventually(lambda: all(map(is_gone, started)))


def test_a_planner_that_hangs_in_c_is_given_up(hub, start_worker, tmp_path) -> None:
    start_worker("--episode-limit", "5.0")
    hub.hear(Hello)
    hub.say(Welcome(SELDOM_S))
    faults = run_four(hub, "hangs in C", tmp_path)
    bad = faults.pop(BAD)
    assert (bad.kind, "longer than 5 s" in bad.message) == ("infrastructure", True)
    assert set(faults.values()) == {None}


def test_no_core_is_dumped_and_the_kernel_takes_the_inner_process_first(lasting_hub, worker):
    run_four(lasting_hub, "prints", Path())
    (pid,) = (p.pid for p in psutil.Process().children() if "worker.child" in " ".join(p.cmdline()))
    assert psutil.Process(pid).rlimit(psutil.RLIMIT_CORE) == (0, 0)
    assert psutil.Process(pid).rlimit(psutil.RLIMIT_NOFILE) == (256, 256)
    assert Path(f"/proc/{pid}/oom_score_adj").read_text() == "1000\n"
    assert os.getpgid(pid) == os.getsid(pid) == pid
