"""What a result and a round cost, measured in one process: no hub, no workers."""

import json
import os
import subprocess
import sys
import time
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory

from benchmarks.episode_loop import tasks
from benchmarks.figures import ROOT, Figure
from benchmarks.speed.learner_cost import CASES
from benchmarks.speed.simulated_workers import examples
from msgspec.structs import replace

from eigenfail.processes import NUMERIC_ENVIRONMENT
from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail.values.records import Delivery
from eigenfail.wire.messages import Ack, Lease, Results, encode
from eigenfail_services.campaigns.validation import check_spec
from eigenfail_services.store.store import open_store

COMMAND = "make bench"
COMMITS = 100
ROWS = 2_000


def cost_figures() -> dict[str, Figure]:
    """All of them."""
    rounds = [rounds_of(name) for name in CASES]
    return {"commit_ms": commit_ms()} | sizes() | {n: f for each in rounds for n, f in each.items()}


def commit_ms() -> Figure:
    """Wall time of a transaction with a single result in it."""
    plain, _ = examples()
    times = []
    with TemporaryDirectory() as folder:
        store = open_store(f"sqlite:///{Path(folder) / 'eigenfail.db'}")
        spec = CampaignSpec(name="commit", method="monte_carlo", episodes=COMMITS)
        campaign = store.campaigns.create(check_spec(spec)).id
        for task in tasks(0, COMMITS, seed=0):
            result = replace(plain, index=task.index, seed=task.seed)
            began = time.perf_counter()
            store.episodes.commit(campaign, [Delivery(result, "w")])
            times.append(1000.0 * (time.perf_counter() - began))
        store.close()
    return Figure(value=median(times), unit="ms", n=COMMITS, command=COMMAND)


def sizes() -> dict[str, Figure]:
    """Bytes of a result: on the wire with its lease and acknowledgement, and in SQLite."""
    plain, _ = examples()
    (task,) = tasks(0, 1, seed=0)
    wire = sum(map(len, map(encode, (Results(1, (plain,)), Lease(1, (task,)), Ack(1, (0,))))))
    with TemporaryDirectory() as folder:
        path = Path(folder) / "eigenfail.db"
        store = open_store(f"sqlite:///{path}")
        spec = CampaignSpec(name="sizes", method="monte_carlo", episodes=ROWS)
        campaign = store.campaigns.create(check_spec(spec)).id
        store.close()
        before = path.stat().st_size
        store = open_store(f"sqlite:///{path}")
        asked = tasks(0, spec.episodes, seed=0)
        results = [replace(plain, index=t.index, seed=t.seed) for t in asked]
        store.episodes.commit(campaign, [Delivery(result, "w") for result in results])
        store.close()
        disk = (path.stat().st_size - before) / len(results)
    return {
        "result_wire_bytes": Figure(value=wire, unit="bytes", n=1, command=COMMAND),
        "result_disk_bytes": Figure(value=disk, unit="bytes", n=len(results), command=COMMAND),
    }


def rounds_of(name: str) -> dict[str, Figure]:
    """What the learner takes for a round, and the hub for its checkpoint."""
    command = [sys.executable, "-m", "benchmarks.speed.learner_cost", name]
    environment = os.environ | NUMERIC_ENVIRONMENT
    done = subprocess.run(
        command, cwd=ROOT, env=environment, capture_output=True, text=True, check=True
    )
    told = json.loads(done.stdout)
    note = f"rounds of {told['round_size']:g} episodes"

    def figure(seconds: float) -> Figure:
        return Figure(value=1000.0 * seconds, unit="ms", n=5, command=COMMAND, note=note)

    return {
        f"learner_ms_{name}": figure(told["learner_s"]),
        f"checkpoint_ms_{name}": figure(told["hub_s"]),
    }
