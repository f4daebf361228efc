"""What the service costs: its rate beside the bare loop's, and with two workers beside one."""

import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from benchmarks.figures import ROOT, Figure, summarize_runs

from eigenfail.client import Client
from eigenfail.hosting.service import Launcher, LocalService, Plan, local_service
from eigenfail.processes import NUMERIC_ENVIRONMENT
from eigenfail_workers.compilation import INTERPRETED_VARIABLE

EPISODES = 500
PAIRS = 3


def run_episode_loop(seed: int, interpreted: bool = False) -> dict[str, float]:
    """One run of the bare loop.

    Raises:
        SystemExit: it is to be compiled, and is not.
    """
    command = [
        sys.executable,
        "-m",
        "benchmarks.episode_loop",
        str(EPISODES),
        str(seed),
    ]
    environment = (
        os.environ | NUMERIC_ENVIRONMENT | {INTERPRETED_VARIABLE: "1" if interpreted else ""}
    )
    done = subprocess.run(
        command, cwd=ROOT, env=environment, capture_output=True, text=True, check=True
    )
    measured: dict[str, float] = json.loads(done.stdout)
    if measured["compiled"] == interpreted:
        raise SystemExit("bench: the episode loop is not compiled: run eigenfail_workers.compiler")
    return measured


def campaign_rate(client: Client, seed: int) -> float:
    """Episodes per second of a Monte Carlo campaign, from its first result to its last."""
    created = client.campaigns.create(
        name="bench", method="monte_carlo", episodes=EPISODES, seed=seed
    )
    ended = client.campaigns.wait(created.id, timeout_s=600)
    if ended.counts.completed != EPISODES:
        raise SystemExit(f"bench: {ended.state}, {ended.counts}: {ended.stopped_because}")
    finished = sorted(row.finished_ms for row in client.episodes.list(created.id))
    # Results are committed in groups: those of the first group have no measured beginning.
    first = finished.count(finished[0])
    return 1000 * (len(finished) - first) / (finished[-1] - finished[0])


@contextmanager
def another_worker(service: LocalService) -> Iterator[None]:
    """One more worker, beside the one that Ray started."""
    command = [sys.executable, "-m", "eigenfail_workers", "--connect", service.address.hub]
    process = subprocess.Popen([*command, "--name", "second"], stdout=subprocess.DEVNULL)
    try:
        time.sleep(3.0)
        yield
    finally:
        process.terminate()
        process.wait(30)


def service_figures() -> dict[str, Figure]:
    """Bare, one worker, two workers, in turn, so that the machine's moods hit all three."""
    bares, ones, twos, cpus, interpreted = [], [], [], [], []
    with tempfile.TemporaryDirectory() as folder:
        plan = Plan(Path(folder), port=0, workers=1, launcher=Launcher.RAY)
        with local_service(plan) as service, Client(service.address.url) as client:
            campaign_rate(client, seed=99)
            for seed in range(PAIRS):
                measured = run_episode_loop(seed)
                bares.append(measured["episodes_per_s"])
                cpus.append(measured["cpu_ms"])
                interpreted.append(run_episode_loop(seed, interpreted=True)["cpu_ms"])
                ones.append(campaign_rate(client, seed))
                with another_worker(service):
                    campaign_rate(client, seed=98)  # it loads the simulator: once, not per campaign
                    twos.append(campaign_rate(client, seed))
    over_bare = [one / alone for one, alone in zip(ones, bares, strict=True)]
    over_one = [two / one for two, one in zip(twos, ones, strict=True)]
    return {
        "service_over_bare": summarize_runs(over_bare, "ratio", ">= 0.90"),
        "two_workers_over_one": summarize_runs(over_one, "ratio", ">= 1.8"),
        "episode_cpu_ms": summarize_runs(cpus, "ms", "<= 4", n=EPISODES * PAIRS),
        "episode_cpu_interpreted_ms": summarize_runs(
            interpreted, "ms", "<= 12", n=EPISODES * PAIRS
        ),
        "service_episodes_per_s": summarize_runs(ones, "1/s"),
    }
