"""Planners that a stranger might bring, in real processes: each costs what it did itself."""

import os
import signal
from collections.abc import Callable, Iterator
from contextlib import suppress
from itertools import count
from pathlib import Path
from threading import Thread

import deadlines
import numpy as np
import psutil
import pytest

from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail.values.episode import EpisodeTask, Outcome, TrajectorySource
from eigenfail.wire.messages import Ack, Hello, Lease, Results, Setup, Welcome
from eigenfail_workers.limits import Limits
from eigenfail_workers.worker.parent import Parent

pytestmark = pytest.mark.service

LIMITS = Limits(memory_mib=320.0, files=256, threads=32)
BAD = 1
KIB = 1024
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
        worker.shut_down()
        worker.shut_down()
        thread.join(timeout=deadlines.PROCESS_S)
    assert not thread.is_alive()


def setup(campaign: int, planner: str, **settings: object) -> Setup:
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
    "interrupts": ("planner", "raised KeyboardInterrupt"),
    "mumbles": ("infrastructure", "killed its process (exit status -9)"),
    "leaves": ("planner", "raised SystemExit: 4"),
}


@pytest.mark.fault(
    "planner that leaks memory, threads or processes",
    group="plug-ins",
    outcome="Its inner process is killed at the [limit](reliability.md#bounds), three times; "
    "then the episode is errored, kind `infrastructure`, and the message names limit and "
    "setting.",
)
@pytest.mark.fault(
    "planner that leaks open files, or allocates more memory than there is",
    group="plug-ins",
    outcome="The episode is errored, kind `planner`. A process with few files left is "
    "replaced before the next episode.",
)
@pytest.mark.fault(
    "planner that ends its own process",
    group="plug-ins",
    outcome="After a segmentation fault or `os._exit` the episode runs three times and is then "
    "errored, kind `infrastructure`. After `SystemExit`, `KeyboardInterrupt` or another "
    "exception that is raised, it is errored at once, kind `planner`.",
)
@pytest.mark.fault("planner that writes into the pipe of results")
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


@pytest.mark.fault(
    "planner that prints without end",
    group="plug-ins",
    outcome="The worker passes on 64 KiB per episode to its standard error (`--output-"
    "limit`), says that it suppresses the rest, and reads on, so that no episode "
    "waits or is lost.",
)
@pytest.mark.fault(
    "planner that reads standard input",
    group="plug-ins",
    outcome="It reads an empty file; no episode waits or is lost.",
)
@pytest.mark.parametrize("way", ["prints", "reads"])
def test_who_prints_much_or_waits_for_input_costs_nothing(
    lasting_hub, worker, tmp_path, way
) -> None:
    assert set(run_four(lasting_hub, way, tmp_path).values()) == {None}


@pytest.mark.fault("planner that prints without end")
def test_a_worker_passes_on_a_limited_part_of_what_each_episode_prints(
    hub, start_worker, tmp_path
) -> None:
    worker = start_worker("--output-limit", "2")
    hub.hear(Hello)
    tasks = tuple(task(index, leaps=False) for index in range(3))
    hub.say(Welcome(SELDOM_S), setup(1, "test_prints", kib=512), Lease(1, tasks))
    assert [hub.hear(Results).results[0].fault for _ in tasks] == [None] * 3
    hub.say(Ack(1, (0, 1, 2)))
    worker.terminate()
    assert worker.wait(deadlines.PROCESS_S) == 0
    said = (tmp_path / "said").read_text()
    resets = len(tasks) + 1  # the limit holds before the first episode, too
    assert KIB < said.count("x") < resets * 2 * KIB
    assert 1 <= said.count("output suppressed") <= resets
    assert "more than 2 KiB in this episode" in said
    assert "(--output-limit of the worker, or EIGENFAIL_OUTPUT_LIMIT_KIB)" in said
    assert "episode 0 begins" in said


@pytest.mark.fault("planner that leaks open files, or allocates more memory than there is")
def test_files_that_a_planner_forgets_cost_no_episode(lasting_hub, worker) -> None:
    campaign, episodes = next(campaigns), range(12)
    tasks = tuple(task(index, leaps=False) for index in episodes)
    lasting_hub.say(setup(campaign, "test_forgets_files"), Lease(campaign, tasks))
    results = [lasting_hub.hear(Results).results[0] for _ in episodes]
    assert sorted(result.index for result in results) == list(episodes)
    assert all(result.outcome is not Outcome.ERRORED for result in results)
    lasting_hub.say(Ack(campaign, tuple(episodes)))


@pytest.mark.fault(
    "planner that leaves processes behind",
    group="plug-ins",
    outcome="They are killed with its inner process, whatever ended it, also in sessions of "
    "their own and without a parent.",
)
@pytest.mark.parametrize("way", ["forks and dies", "escapes and dies"])
def test_what_a_planner_started_does_not_outlive_its_process(
    lasting_hub, worker, tmp_path, eventually, way
) -> None:
    run_four(lasting_hub, way, tmp_path)
    assert forked(tmp_path)
    eventually(lambda: all(map(is_gone, forked(tmp_path))))


def descendants(pid: int) -> list[int]:
    return [each.pid for each in psutil.Process(pid).children(recursive=True)]


@pytest.fixture
def busy(hub, start_worker, tmp_path, eventually) -> Callable[[str], list[int]]:
    """Has a planner of a worker start something; the processes of both are told."""

    def run(way: str) -> list[int]:
        worker = start_worker()
        hub.hear(Hello)
        planner = setup(1, "test_misbehaves", way=way, folder=str(tmp_path))
        hub.say(Welcome(SELDOM_S), planner, Lease(1, (task(0, leaps=True),)))
        eventually(lambda: forked(tmp_path))
        # A process that escapes has, for a moment, a parent that is just ending.
        eventually(lambda: set(forked(tmp_path)) < set(descendants(worker.pid)))
        return [worker.pid, *descendants(worker.pid)]

    return run


@pytest.mark.fault("planner that leaves processes behind")
@pytest.mark.parametrize("way", ["forks and hangs", "escapes and hangs"])
@pytest.mark.parametrize("signal_to_end", [signal.SIGKILL, signal.SIGTERM])
def test_nothing_outlives_a_worker_that_ends(busy, eventually, way, signal_to_end) -> None:
    worker, *below = busy(way)
    os.kill(worker, signal_to_end)
    eventually(lambda: all(map(is_gone, below)))


@pytest.mark.fault(
    "SIGKILL of the guard of an inner process",
    group="processes",
    outcome="The inner process dies with its guard, and the worker starts another one.",
)
def test_the_guard_is_killed_last_of_all_or_takes_the_planner_with_it(busy, eventually) -> None:
    _, guard, *below = busy("forks and hangs")
    os.kill(guard, signal.SIGKILL)
    eventually(lambda: is_gone(below[0]))


@pytest.mark.fault(
    "planner that leaves threads or processes spinning",
    group="plug-ins",
    outcome="Its inner process is killed at the [limit](reliability.md#bounds) of processor "
    "time; an episode that ran then is tried again, and errored after the third time.",
)
def test_what_a_planner_leaves_spinning_is_ended_though_its_episodes_were_quick(
    hub, start_worker, tmp_path, eventually
) -> None:
    start_worker("--cpu-limit", "10")
    hub.hear(Hello)
    hub.say(Welcome(SELDOM_S))
    assert set(run_four(hub, "leaves one that spins", tmp_path).values()) == {None}
    eventually(lambda: all(map(is_gone, forked(tmp_path))))


@pytest.mark.fault("planner or simulator that hangs")
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
    checked = 0
    for guard in psutil.Process().children():
        # Those of earlier campaigns may be closing.
        with suppress(psutil.NoSuchProcess, ProcessLookupError, FileNotFoundError):
            if "worker.child" not in " ".join(guard.cmdline()):
                continue
            (pid,) = (child.pid for child in guard.children())
            assert psutil.Process(pid).rlimit(psutil.RLIMIT_CORE) == (0, 0)
            assert psutil.Process(pid).rlimit(psutil.RLIMIT_NOFILE) == (256, 256)
            assert Path(f"/proc/{pid}/oom_score_adj").read_text() == "1000\n"
            assert os.getpgid(pid) == os.getsid(pid) == pid
            checked += 1
    assert checked
