"""Print the second table of benchmarks/performance.md: which process of a service works how long.

A Monte Carlo campaign on cut_in with one worker; the processor's time that each process spent on
it, beside that of the bare loop. `service_profile.py [EPISODES]`.
"""

import os
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import psutil
from benchmarks.speed.service import run_episode_loop

from eigenfail.client import Client
from eigenfail.hosting.service import Launcher, LocalService, Plan, local_service

EPISODES = 500
SEED = 7
COLUMNS = ("process", "CPU ms per episode", "what it does")
BARE = "the bare loop, in one process"
PROCESSES = {
    "eigenfail_workers.worker.child": ("worker, inner process", "the same loop; heartbeats"),
    "eigenfail_workers": ("worker, outer process", "leases and results, between hub and pipe"),
    "eigenfail_services": ("services", "hub, method, store: results committed in groups"),
    "eigenfail_api": ("controller", "answers the client, which asks how far it is"),
}
"""By the module that a process runs."""


@contextmanager
def worker(service: LocalService) -> Iterator[None]:
    """One worker that Ray has not started: it is a child of this process."""
    command = [sys.executable, "-m", "eigenfail_workers", "--connect", service.address.hub]
    process = subprocess.Popen([*command, "--name", "profiled"], stdout=subprocess.DEVNULL)
    try:
        yield
    finally:
        process.terminate()
        process.wait(30)


def module(process: psutil.Process) -> str:
    """What `python -m` was told to run; nothing for other processes."""
    words = process.cmdline()
    return words[words.index("-m") + 1] if "-m" in words[:-1] else ""


def cpu_s() -> Counter[str]:
    """Processor time that each kind of process below this one has spent so far."""
    spent: Counter[str] = Counter()
    for process in psutil.Process().children(recursive=True):
        times = process.cpu_times()
        spent[module(process)] += times.user + times.system
    return spent


def campaign(client: Client, episodes: int) -> None:
    """Run one to its end."""
    created = client.campaigns.create(
        name="profile", method="monte_carlo", episodes=episodes, seed=SEED
    )
    ended = client.campaigns.wait(created.id, timeout_s=600)
    if ended.counts.completed != episodes:
        raise SystemExit(f"profile: {ended.state}, {ended.counts}: {ended.stopped_because}")


def measure(episodes: int) -> tuple[Counter[str], float]:
    """Processor seconds by kind of process, and wall seconds, of one campaign."""
    with tempfile.TemporaryDirectory() as folder:
        plan = Plan(Path(folder), port=0, workers=1, launcher=Launcher.NONE)
        with (
            local_service(plan) as service,
            Client(service.address.url) as client,
            worker(service),
        ):
            campaign(client, 20)  # loads simulator and planner
            before, began = cpu_s(), time.perf_counter()
            campaign(client, episodes)
            return cpu_s() - before, time.perf_counter() - began


def lines(episodes: int) -> Iterator[str]:
    """The table in Markdown."""
    spent, took_s = measure(episodes)
    yield "| " + " | ".join(COLUMNS) + " |"
    yield "|---|--:|---|"
    yield f"| {BARE} | {run_episode_loop(SEED)['cpu_ms']:.2f} | nothing but episodes |"
    for kind, (name, meaning) in PROCESSES.items():
        yield f"| {name} | {1000 * spent[kind] / episodes:.2f} | {meaning} |"
    each_ms = 1000 * took_s / episodes
    yield f"| wall time | {each_ms:.2f} | of the campaign, on {os.cpu_count()} cores |"


if __name__ == "__main__":
    print("\n".join(lines(int((*sys.argv, EPISODES)[1]))))
